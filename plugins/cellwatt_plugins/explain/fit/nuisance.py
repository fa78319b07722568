"""Nominal parameters that may be off by their tolerances: always free, so that no effect is named in their place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.baseline import FRICTION
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.drive import copper_loss
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.priors import link_prior
from cellwatt_plugins.robot.regression import Prior

GAIN = 0.02
"""Standard deviation of a servo's gains, as a share."""
STEP = 0.0007
"""s by which the velocity that a drive damps differs in age from its position (steps of control and simulation)."""
TURNED = 0.5
"""Share of a joint's friction that may reverse over another speed range."""
LATE = 0.1
"""Standard deviation of the delay of commands about half a row, in rows."""
FINE = 1e-3
"""Share of the simulated values from which simulated terms without a parameter in robot.yaml count as present."""

NUMBERS = {
    "coulomb_friction": ("N*m", "friction"),
    "viscous_friction": ("N*m*s/rad", "friction"),
    "rotor_inertia": ("kg*m^2", "rotor_inertia"),
    "standby_power": ("W", "supply"),
    "winding_resistance": ("Ohm", "supply"),
}
"""Unit of each parameter of robot.yaml that may be off, and the key of its tolerance."""


@dataclass(frozen=True, eq=False)
class Nominal(Block):
    """Nominal parameters that may be off: those of a ``link`` (10,), or one number by its key in robot.yaml."""

    name: str = ""
    """Empty if robot.yaml has no parameter for it."""
    joint: int | None = None
    """0-based; None for the supply."""


def torque_nuisance(states: Sequence[States]) -> tuple[Nominal, ...]:
    """Inertial parameters of each link, then friction and rotor inertia of each joint where they are not 0.

    Then further simulated terms of each joint, with the tolerance of friction.
    """
    robot, body = states[0].robot, states[0].arm.body
    regressor = np.concatenate([s.regressor for s in states])
    blocks = [
        Nominal(
            regressor[:, :, PER_LINK * i : PER_LINK * (i + 1)], None, link_prior(own, robot.tolerances.link), "link", i
        )
        for i, own in enumerate(body.parameters().reshape(-1, PER_LINK))
    ]
    blocks += [
        _of_motor(states, name, joint, Prior.spread(np.array([getattr(robot.tolerances, NUMBERS[name][1]) * value])))
        for name in FRICTION
        for joint, value in enumerate(robot.column(name))
        if value > 0
    ]
    if states[0].drive is not None:
        return (*blocks, *_drives(states))
    if all(s.beyond is not None for s in states):
        blocks += _beyond([s.beyond for s in states], [s.nominal for s in states], robot.tolerances.friction)
    return tuple(blocks)


def _of_motor(states: Sequence[States], name: str, joint: int, prior: Prior) -> Nominal:
    columns = np.concatenate([BY_NAME[name].acting(s, joint, ()) for s in states])
    return Nominal(columns, None if columns.ndim == 3 else joint, prior, name, joint)


def _beyond(courses: Sequence[Float | None], whole: Sequence[Float], tolerance: float) -> list[Nominal]:
    """Simulated terms beyond the law, a factor per channel: ``courses`` (N, C) of each run, ``whole`` with the law."""
    beyond = np.concatenate([course for course in courses if course is not None])
    present = np.std(beyond, axis=0) > FINE * np.std(np.concatenate(whole), axis=0)
    prior = Prior.spread(np.array([tolerance]))
    return [Nominal(beyond[:, c : c + 1], c, prior) for c in np.flatnonzero(present).tolist()]


def _drives(states: Sequence[States]) -> list[Nominal]:
    """Gain and damping of each joint's servo, as shares, and the delays of velocities and commands in s."""
    servo, step = states[0].servos.servo, states[0].servos.step
    motion = ((s.nominal, s.qd, s.qdd, s.servos.commanded_velocity) for s in states)
    torque, speed, gain, commanded = (np.concatenate(parts) for parts in zip(*motion, strict=True))
    braked = servo.damping * speed
    coulomb = states[0].robot.column("coulomb_friction")
    coulomb = np.maximum(coulomb, np.median(coulomb))[:, None]
    turning = coulomb * np.concatenate([s.servos.turnovers for s in states])
    columns = np.stack([torque + braked, braked, servo.damping * gain, servo.stiffness * commanded], axis=2)
    columns = np.concatenate([columns, turning], axis=2)
    prior = Prior.spread(np.array([GAIN, GAIN, STEP, LATE * step, *[TURNED] * turning.shape[2]]))
    return [Nominal(columns[:, joint], joint, prior, "drive", joint) for joint in range(columns.shape[1])]


def supply_nuisance(states: Sequence[States]) -> tuple[Nominal, ...]:
    """Standby power and the winding resistance of each joint, where they are not 0; then further simulated terms."""
    robot = states[0].robot
    tolerance = robot.tolerances.supply
    blocks = []
    if robot.standby_power > 0:
        ones = np.ones((sum(len(s.time) for s in states), 1))
        blocks.append(Nominal(ones, 0, Prior.spread(np.array([tolerance * robot.standby_power])), "standby_power"))
    losses = np.concatenate([copper_loss(robot, s.torque) for s in states])
    blocks += [
        Nominal(losses[:, joint : joint + 1], 0, Prior.spread(np.array([tolerance])), "winding_resistance", joint)
        for joint in np.flatnonzero(np.any(losses > 0, axis=0)).tolist()
    ]
    if all(s.beyond_power is not None for s in states):
        own = [None if s.beyond_power is None else s.beyond_power[:, None] for s in states]
        blocks += _beyond(own, [s.nominal_power[:, None] for s in states], tolerance)
    return tuple(blocks)
