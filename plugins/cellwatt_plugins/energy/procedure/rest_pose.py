"""Finds the pose of least gravity torque, at which the brakes' power is measured (ECDP, eq. 15)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.progress import steps
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.collision import CLEARANCE, Checker

STARTS: Final = 32
"""Number of start poses of the search, from a Sobol sequence."""
PUSH: Final = 1e4
"""Penalty for missing clearance, relative to gravity torque, Nm/m."""
STEPS: Final = 100
PUSHED: Final = 20
"""Most evaluations of one descent, and of one near the arm itself or the floor, where they are slow."""
SAME: Final = 0.02
"""Largest difference between equal minima, Nm, and as a share."""


@dataclass(frozen=True)
class RestPose:
    """θ_GZ: pose ``q`` (n,) rad and the ``torque`` (n,) Nm that holds the arm in it.

    ``reached`` of the ``starts`` ended at an equally good pose; if only a few did, more starts may find a better one.
    ``clearance`` m is the smallest distance between links, or to the floor.
    """

    q: Float
    torque: Float
    starts: int
    reached: int
    clearance: float

    @property
    def residual(self) -> float:
        """‖G(θ_GZ)‖, Nm."""
        return float(np.linalg.norm(self.torque))


def rest_pose(arm: Arm, starts: int = STARTS) -> RestPose:
    """θ_GZ = arg min ‖G(θ)‖ within the joints' limits, clear of the arm itself and the floor (eq. 15).

    Returns the best minimum from ``starts`` start poses. Raises ``ConfigError`` if none is clear.
    """
    from scipy.stats import qmc  # takes a second to import, and only this search needs it

    # Poses recur beyond half a turn either way.
    limits = np.clip(arm.finite_limits(), -np.pi, np.pi)
    checker = Checker(arm, limits)
    edge = 1e-6 * np.ptp(limits, axis=1)
    lower, upper = limits[:, 0] + edge, limits[:, 1] - edge
    shares = qmc.Sobol(len(limits), scramble=False).random(starts)
    poses = [np.clip(np.zeros(len(limits)), lower, upper), *(lower + shares[1:] * (upper - lower))]

    found = [_descend(arm, pose, (lower, upper), checker) for pose in steps(poses, "searching from pose")]
    free = [q for q in found if checker.safe(q[None])[0]]
    if not free:
        raise ConfigError(
            "no pose of least gravity is clear of the arm itself and the floor: correct capsules and floor, "
            "or the joints' limits, in robot.yaml"
        )
    norms = np.linalg.norm(arm.gravity(np.array(free)), axis=1)
    best = norms <= norms.min() * (1 + SAME) + SAME
    # Of equally good poses, the one whose joints are nearest to the middle of their ranges.
    middle = limits.mean(axis=1)
    chosen = min((q for q, good in zip(free, best, strict=True) if good), key=lambda q: float(np.abs(q - middle).max()))
    return RestPose(
        q=chosen,
        torque=arm.gravity(chosen[None])[0],
        starts=starts,
        reached=int(best.sum()),
        clearance=float(checker.gaps(chosen[None]).min(initial=np.inf)),
    )


def _descend(arm: Arm, start: Float, bounds: tuple[Float, Float], checker: Checker) -> Float:
    """The minimum of ‖G‖ reached from a start pose; if it is not clear, a nearby pose pushed clear."""

    def gravity(q: Float) -> Float:
        return np.asarray(arm.gravity(q[None])[0])

    def slope(q: Float) -> Float:
        return np.asarray(arm.body.gravity_slope(q[None])[0])

    def with_push(q: Float) -> Float:
        return np.concatenate([gravity(q), PUSH * np.maximum(1.05 * CLEARANCE - checker.gaps(q[None])[0], 0.0)])

    there = np.asarray(least_squares(gravity, start, slope, bounds, max_nfev=STEPS).x)
    if checker.safe(there[None])[0]:
        return there
    return np.asarray(least_squares(with_push, there, bounds=bounds, max_nfev=PUSHED).x)
