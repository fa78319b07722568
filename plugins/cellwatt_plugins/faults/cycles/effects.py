"""Supply power of each type of fault and of harmless change.

An additional torque Δτ at joint j adds ΔP = g (q̇_j + 2 c_j τ_j) Δτ; a winding with (1 + a) times its resistance adds
g c_j τ_j² a; a joint that a brake or nothing holds instead of its motor saves its g c_j τ_j².
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Parameters, friction
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.load import Load
from cellwatt_plugins.robot.motion import direction

SPRING = 10.0
"""A spring's stiffness per radian and its offset torque, relative to the joint's Coulomb friction (one sigma)."""
AT_REST = math.radians(2.0)
"""A joint that moves less than this, rad, only holds its position …"""
LEAST_UNHELD, MOST_UNHELD = 0.5, 1.5
"""… and if its motor does not hold it, all its holding power is missing: between these shares of the model's value."""
PART = 0.3
REACH = 0.06
UNSURE = 0.03
"""Change of a part's mass, kg (one sigma), its distance from the last link's frame, m, and that distance's sigma, m."""
STEP, STEP_EVERY = 20.0, 2
"""A step of the supply's level, W (one sigma), and the number of samples between the steps that are tried; the power of
these samples is open."""
LOAD, MOST_LOAD = 0.1, 3.0
"""Change of the load of a bare arm by a part, as a share: of all joints together and of each (one sigma); and the
largest change, in sigmas."""


@dataclass(frozen=True, eq=False)
class Effect:
    """``columns`` (N, k) W per sigma of each size; ``joint`` 0-based, None for a part in the gripper.

    ``torque`` (N, k) Nm at the joint per sigma, None if the effect is not a torque.
    """

    what: str
    joint: int | None
    columns: Float
    torque: Float | None = None
    at_supply: bool = False
    """True if the power is drawn beside the drives, and never returned."""

    @property
    def harmless(self) -> bool:
        """True if the effect is not a fault."""
        return self.joint is None

    def sensible(self, sizes: Float) -> bool:
        """True if the sizes have the sign, or are near the value, that the cause requires."""
        if self.what == "load":
            return bool(np.abs(sizes).max() < MOST_LOAD)
        if self.what == "unheld":
            return bool(LEAST_UNHELD < sizes[0] < MOST_UNHELD)
        return self.harmless or bool(sizes[0] > 0)


def joint_effects(arm: FittedArm, load: Load, joint: int) -> Iterator[Effect]:
    """Faults of a joint that follows its path."""
    p, qd, lever = arm.parameters, load.motion.qd[:, joint], load.lever[:, joint]
    coulomb, viscous = p.coulomb[joint], p.viscous[joint]
    extra = np.column_stack([direction(qd) * coulomb, viscous * qd])
    yield Effect("friction", joint, lever[:, None] * extra, extra)
    angle = load.motion.q[:, joint] / arm.body.levers[joint]
    stiff = SPRING * max(coulomb, 1e-3)
    pull = stiff * np.column_stack([angle - angle[0], np.ones(len(angle))])
    yield Effect("spring", joint, lever[:, None] * pull, pull)
    copper = (load.gain * p.copper[joint] * load.torque[:, joint] ** 2)[:, None]
    yield Effect("winding", joint, copper)
    if np.ptp(angle) < AT_REST:
        yield Effect("unheld", joint, -copper)


def part_effects(arm: FittedArm, load: Load, inside: Float) -> Iterator[Effect]:
    """A heavier or lighter part, held between any two moves; ``inside`` (N, M + 1) is 1 after each move's start."""
    what, columns = ("load", _load_columns(arm, load)) if arm.bare else ("part", _part_columns(arm, load))
    for begin, end in combinations(range(inside.shape[1]), 2):
        held = inside[:, begin] - inside[:, end]
        yield Effect(what, None, columns * held[:, None])


def step_effects(count: int) -> Iterator[Effect]:
    """A step of the supply's level within ``count`` samples, as by a fan that is switched."""
    for begin in range(STEP_EVERY, count - STEP_EVERY, STEP_EVERY):
        columns = np.zeros((count, 1 + STEP_EVERY))
        columns[begin + STEP_EVERY :, 0] = STEP
        columns[begin : begin + STEP_EVERY, 1:] = STEP * np.eye(STEP_EVERY)
        yield Effect("step", None, columns, at_supply=True)


def _load_columns(arm: FittedArm, load: Load) -> Float:
    """Power (N, 1 + n) W per sigma of a change of the load of all joints, and of each."""
    each = LOAD * load.lever * (load.torque - friction(arm.parameters, load.motion.qd))
    return np.column_stack([each.sum(axis=1), each])


def _part_columns(arm: FittedArm, load: Load) -> Float:
    """Power (N, 2) W per sigma of a part's mass and of its distance."""
    last = load.regressor[:, :, -10:]
    centre = arm.parameters.link[-9:-6]
    direction = centre / max(float(np.linalg.norm(centre)), 1e-9)
    moment = np.einsum("ij,ijk,k->i", load.lever, last[:, :, 1:4], direction)
    mass = PART * (np.einsum("ij,ij->i", load.lever, last[:, :, 0]) + REACH * moment)
    return np.column_stack([mass, PART * UNSURE * moment])


def warm_up(parameters: Parameters, load: Load) -> Float:
    """Power (N,) W of the friction of all joints."""
    return np.asarray(np.sum(load.lever * friction(parameters, load.motion.qd), axis=1))
