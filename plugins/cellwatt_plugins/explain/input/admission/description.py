"""Differences between the description and the simulation with which the recordings are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt_plugins.explain.fit.leave_out import rms
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot import Arm, RobotDescription
from cellwatt_plugins.robot.drive import nominal_power

WORTH = 0.02
"""Share of the simulated rms above which a difference is reported."""
UNITS = {"coulomb_friction": "Nm", "viscous_friction": "Nm s/rad", "rotor_inertia": "kg m²"}


def description_remarks(runs: Sequence[Run], arm: Arm, base: Baseline) -> list[str]:
    """One remark if robot.yaml or the URDF contradict the simulation; numbers that they omit are not compared."""
    simulations = [run.simulated for run in runs if run.simulated is not None]
    if not simulations:
        return []
    simulated = base.arm.description
    described = _completed(arm.description, simulated)
    law = replace(arm, description=described)
    torque = np.concatenate([each.torque for each in simulations])
    size, off = rms(torque), rms(torque - np.concatenate([law.torque(*each.plan.courses) for each in simulations]))
    parts = [
        f"joint {i + 1} by {off[i]:.2g} {described.unit(i, 'Nm')}{_how(described, simulated, i)}"
        for i in range(len(off))
        if off[i] > WORTH * max(size[i], 0.1 * float(size.max()))
    ]
    powered = [(each, each.power) for each in simulations if each.power is not None]
    if powered:
        off = rms(np.concatenate([p - nominal_power(described, s.torque, s.plan.velocity) for s, p in powered]))
        watts, drawn = float(off), float(rms(np.concatenate([p for _, p in powered])))
        parts += [f"the supply by {watts:.3g} W"] if watts > WORTH * drawn else []
    if not parts:
        return []
    what = "robot.yaml or the URDF differs from the simulation"
    return [f"{what}: {'; '.join(parts)} (rms). The recording is compared with the simulation"]


def _completed(robot: RobotDescription, simulated: RobotDescription) -> RobotDescription:
    """The description, completed with the simulation's numbers where it omits them."""
    joints = tuple(
        other.model_copy(update={name: getattr(own, name) for name in own.model_fields_set})
        for own, other in zip(robot.joints, simulated.joints, strict=True)
    )
    standby = robot.standby_power if "standby_power" in robot.model_fields_set else simulated.standby_power
    lead = simulated.friction_lead
    return robot.model_copy(update={"joints": joints, "standby_power": standby, "friction_lead": lead})


def _how(described: RobotDescription, simulated: RobotDescription, joint: int) -> str:
    """The numbers of a joint that differ, in words."""
    pairs = {name: (getattr(described.joints[joint], name), getattr(simulated.joints[joint], name)) for name in UNITS}
    parts = [
        f"{name.replace('_', ' ').replace('coulomb', 'Coulomb')} {own:.3g} "
        f"instead of {other:.3g} {described.unit(joint, UNITS[name])}"
        for name, (own, other) in pairs.items()
        if abs(own - other) > WORTH * max(own, other)
    ]
    return f" ({', '.join(parts)})" if parts else ""
