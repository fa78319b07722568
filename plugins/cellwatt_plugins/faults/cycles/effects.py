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
from cellwatt_plugins.faults.cycles.arm import Parameters, friction, heft
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.load import Load
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.regression import Whitener

SPRING = 10.0
"""A spring's stiffness per radian and its offset torque, relative to the joint's Coulomb friction (one sigma)."""
AT_REST = math.radians(2.0)
"""A joint that moves less than this, rad, only holds its position …"""
LEAST_UNHELD, MOST_UNHELD = 0.5, 1.5
"""… and if its motor does not hold it, all its holding power is missing: between these shares of the model's value."""
PART = 0.3
"""Change of a part's mass, kg (one sigma), …"""
REACH, UNSURE = 0.06, 0.03
"""… its distance from the last link's frame and that distance's sigma, m, all of an arm of ``USUAL_MASS``."""
LOAD, MOST_LOAD = 0.1, 3.0
"""Change of the load of a bare arm by a part, as a share: of all joints together and of each (one sigma); and the
largest change, in sigmas."""
SWITCHED = 10.0
"""Power of a load of the supply, as a fan, that switches during a cycle, W (one sigma)."""
FIRST, STRIDE = 8, 5
"""Points from either end of a cycle within which no switching is looked for, and between the moments tried first."""


@dataclass(frozen=True, eq=False)
class Effect:
    """``columns`` (N, k) W per sigma of each size; ``joint`` 0-based, None for a part in the gripper or a load of the
    supply, whose first size has the ``sigma`` kg (a share of the load, for a bare arm) or W.

    ``torque`` (N, k) Nm at the joint per sigma, None if the effect is not a torque.
    """

    what: str
    joint: int | None
    columns: Float
    torque: Float | None = None
    at_supply: bool = False
    """True if the power is drawn beside the drives, and never returned."""
    sigma: float = 1.0

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
    if arm.bare:
        what, sigma, columns = "load", LOAD, _load_columns(arm, load)
    else:
        what, sigma, columns = "part", PART * heft(arm.parameters.link), _part_columns(arm, load)
    for begin, end in combinations(range(inside.shape[1]), 2):
        held = inside[:, begin] - inside[:, end]
        yield Effect(what, None, columns * held[:, None], sigma=sigma)


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
    part, longer = PART * heft(arm.parameters.link), np.cbrt(heft(arm.parameters.link))
    mass = part * (np.einsum("ij,ij->i", load.lever, last[:, :, 0]) + longer * REACH * moment)
    return np.column_stack([mass, part * longer * UNSURE * moment])


def supply_effects(white: Whitener, residual: Float, points: int) -> Iterator[Effect]:
    """A load of the supply that switches once, at the moment that explains a white residual best."""
    point = np.arange(points)[:, None]

    def best(moments: range) -> int:
        columns = white(SWITCHED * (point >= np.array(moments)).astype(np.float64))
        return moments[int(np.argmax((residual @ columns) ** 2 / (1 + np.square(columns).sum(axis=0))))]

    if points > 2 * FIRST:
        about = best(range(FIRST, points - FIRST, STRIDE))
        moment = best(range(max(FIRST, about - STRIDE), min(points - FIRST, about + STRIDE)))
        # It switches within this point or the one before it, each a mean over a time.
        within = np.hstack([point >= moment, point == moment - 1, point == moment]).astype(np.float64)
        yield Effect("switched", None, SWITCHED * within, at_supply=True, sigma=SWITCHED)


def warm_up(parameters: Parameters, load: Load) -> Float:
    """Power (N,) W of the friction of all joints."""
    return np.asarray(np.sum(load.lever * friction(parameters, load.motion.qd), axis=1))
