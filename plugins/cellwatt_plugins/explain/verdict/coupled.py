"""The drive train of the arm, checked before the physics: whether each joint has a motor of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.report.numbers import listed
from cellwatt_plugins.explain.fit.coupling import Coupling, couplings
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.verdict.findings import Finding, Improvement, Where
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.effect import Parameter
from cellwatt_plugins.robot.effects.states import States


def as_coupled(
    runs: Sequence[Run], states: Sequence[States], base: Baseline
) -> tuple[Baseline, Sequence[States], list[Finding]]:
    """Baseline and states with the couplings found from measured torques; unchanged where each joint has its motor."""
    if states[0].drive is not None:
        return base, states, []
    found = couplings(states, [run.torque - s.nominal + s.motors_law for run, s in zip(runs, states, strict=True)])
    if not found:
        return base, states, []
    turns = np.eye(states[0].arm.joints)
    for each in found:
        turns[np.ix_(each.joints, each.joints)] = each.turns
    base = replace(base, recorded=base.recorded.with_coupling(turns))
    new = [replace(s, arm=base.recorded, fitted=None, carried=None) for s in states]
    return base, new, [_finding(each, base.arm.description) for each in found]


def _finding(found: Coupling, robot: RobotDescription) -> Finding:
    first, second = (joint + 1 for joint in found.joints)
    both = [motor for motor, turn in enumerate(found.turns) if all(turn)]
    who = "their motors turn" if len(both) > 1 else f"the motor of joint {found.joints[both[0]] + 1} turns"
    statement = (
        f"Joints {first} and {second} are coupled: {who} by {_angle(found, both)}, so "
        "friction and rotor load both joints. One motor a joint, as in the simulation, leaves this out."
    )
    ratios = {
        f"motor_{found.joints[motor] + 1}_per_joint_{found.joints[1 - motor] + 1}": Parameter(
            float(found.turns[motor][1 - motor]), 0.0, ""
        )
        for motor in both
    }
    best = int(np.argmin(found.after / found.before))
    channels = [f"tau_{joint + 1}" for joint in found.joints]
    unit = robot.unit(found.joints[best], "N*m")
    error = Improvement(channels[best], unit, float(found.before[best]), float(found.after[best]), 0.0)
    return Finding(
        "joint_coupling", second, "structure", 0.99, statement, ratios, Where(tuple(channels)), error, was=0.0
    )


def _angle(found: Coupling, motors: Sequence[int]) -> str:
    if abs(ratio := found.turns[motors[0]][1 - motors[0]]) != 1:
        return f"the angle of its joint and {ratio:+.2f} times that of joint {found.joints[1 - motors[0]] + 1}"
    ways = [f"the {'sum' if np.prod(found.turns[motor]) > 0 else 'difference'}" for motor in motors]
    return f"{listed(ways)} of both joints' angles"
