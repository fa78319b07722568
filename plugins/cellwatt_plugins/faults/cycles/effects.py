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


@dataclass(frozen=True, eq=False)
class Effect:
    """``columns`` (N, k) W per sigma of each size; ``joint`` 0-based, None for a part in the gripper.

    ``torque`` (N, k) Nm at the joint per sigma, None if the effect is not a torque.
    """

    what: str
    joint: int | None
    columns: Float
    torque: Float | None = None

    @property
    def harmless(self) -> bool:
        """True if the effect is not a fault."""
        return self.joint is None

    def sensible(self, sizes: Float) -> bool:
        """True if the sizes have the sign, or are near the value, that the cause requires."""
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
    last = load.regressor[:, :, -10:]
    centre = arm.parameters.link[-9:-6]
    direction = centre / max(float(np.linalg.norm(centre)), 1e-9)
    moment = np.einsum("ij,ijk,k->i", load.lever, last[:, :, 1:4], direction)
    mass = PART * (np.einsum("ij,ij->i", load.lever, last[:, :, 0]) + REACH * moment)
    distance = PART * UNSURE * moment
    for begin, end in combinations(range(inside.shape[1]), 2):
        held = inside[:, begin] - inside[:, end]
        yield Effect("part", None, np.column_stack([mass, distance]) * held[:, None])


def warm_up(parameters: Parameters, load: Load) -> Float:
    """Power (N,) W of the friction of all joints."""
    return np.asarray(np.sum(load.lever * friction(parameters, load.motion.qd), axis=1))
