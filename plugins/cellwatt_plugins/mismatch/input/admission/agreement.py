"""Agreement of recorded torques with the robot's description, under one or another reading of the columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from cellwatt_plugins.mismatch.input.factors import usable
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import Moved

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

SAMPLES = 200
"""Samples of a run that are looked at: enough for what is wrong by a factor."""
STOPPED = 0.02
"""rad/s over which friction of unknown size turns its sign; wider than the noise of encoders."""


@dataclass(frozen=True)
class Expected:
    """Torques (N, n) Nm that the description asks for in a motion with ``velocity`` (N, n) rad/s.

    Where the description has no friction (``loose``, (n,)) any amount may come on top.
    """

    torque: Float
    velocity: Float
    loose: Bool

    def strict(self) -> Expected:
        """Without friction beyond the description's."""
        return replace(self, loose=np.zeros_like(self.loose))

    def misfits(self, torque: Float) -> Float:
        """Mean absolute difference over mean absolute torque, both about their medians, joint by joint: (n,)."""
        return np.array([self._misfit(torque[:, k], k) for k in range(torque.shape[1])])

    def table(self, torque: Float) -> Float:
        """Misfit (n, n) of each torque column as if it were each joint's."""
        joints = range(torque.shape[1])
        return np.array([[self._misfit(torque[:, i], k) for k in joints] for i in joints])

    def _misfit(self, torque: Float, joint: int) -> float:
        rest = torque - self.torque[:, joint]
        if self.loose[joint]:
            speed = self.velocity[:, joint]
            ones = np.ones_like(speed)
            terms = np.column_stack([np.tanh(speed / STOPPED), speed, ones, -ones])
            rest = rest - terms @ nnls(terms, rest)[0]
        return spread(rest) / max(spread(torque), 1e-12)


@dataclass(frozen=True)
class Sample:
    """Some samples (N, n) of a run's motion and torque."""

    arm: Arm
    position: Float
    velocity: Float
    acceleration: Float
    torque: Float

    def expected(self, factor: Float | float = 1.0, order: Sequence[int] | None = None) -> Expected:
        """Torque by the description for this motion times ``factor``, its columns in ``order``."""
        motion = (self.position, self.velocity, self.acceleration)
        columns = slice(None) if order is None else list(order)
        q, qd, qdd = (np.asarray(part[:, columns] * factor, np.float64) for part in motion)
        loose = (self.arm.column("coulomb_friction") == 0) | (self.arm.column("viscous_friction") == 0)
        return Expected(self.arm.torque(q, qd, qdd), qd, loose)


def sample_of(run: Run, motion: Moved, arm: Arm) -> tuple[Sample, NDArray[np.intp]]:
    """Evenly spread samples of a run, none of them filled in, and which they are.

    A torque that was not read is taken as the description asks for: it speaks for no other reading.
    """
    kept = usable(run, SAMPLES)
    parts = (motion.position, motion.velocity, motion.acceleration, run.torque)
    sample = Sample(arm, *(part[kept] for part in parts))
    missing = np.isnan(sample.torque)
    if missing.any():
        sample = replace(sample, torque=np.where(missing, sample.expected().torque, sample.torque))
    return sample, kept


def spread(values: Float) -> float:
    """Mean absolute distance from the median; numpy's own median takes three times as long for so few values."""
    count = len(values)
    half = count // 2
    near = np.partition(values, [half - 1, half] if count % 2 == 0 else half)
    middle = near[half] if count % 2 else (near[half - 1] + near[half]) / 2
    return float(np.add.reduce(np.abs(values - middle)) / count)
