"""Agreement of recorded torques with the robot's description, for an interpretation of the columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.factors import usable
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import Moved, Plan
from cellwatt_plugins.robot.signs import STOPPED

SAMPLES = 200
"""Samples of a run that are examined: enough to find what is wrong by a factor."""
TOGETHER = 20
"""Smallest number of samples at which all compared torques were read."""
MOST = 2.0
"""Largest misfit of a joint that enters the mean: a larger one is no more wrong."""
MEAN_OF_NORMAL = 0.8
"""Mean absolute value of a normal distribution, in standard deviations."""


@dataclass(frozen=True)
class Torques:
    """Torque columns (N, n) Nm as they were read, and the mean absolute size (n,) Nm of the noise in each."""

    torque: Float
    noise: Float

    def __mul__(self, factor: Float | float) -> Torques:
        return Torques(self.torque * factor, self.noise * np.abs(factor))

    def ordered(self, order: Sequence[int]) -> Torques:
        """The columns in another order."""
        return Torques(self.torque[:, order], self.noise[list(order)])

    def shares(self) -> Float:
        """Share (n,) of each column's mean square that is not noise."""
        size = np.array([deviation(column) for column in self.torque.T])
        return np.asarray(np.maximum(1 - np.square(self.noise / np.maximum(size, 1e-12)), 0.0))


@dataclass(frozen=True)
class Expected:
    """Torques (N, n) Nm that the description predicts for a motion with ``velocity`` (N, n) rad/s.

    Unless ``strict``, any amount of friction may be added to them.
    """

    torque: Float
    velocity: Float
    strict: bool = False

    def misfits(self, read: Torques) -> Float:
        """Misfit (n,): mean absolute difference over mean absolute torque, both about their medians and beyond noise.

        0 for a torque that is noise alone, which carries no information.
        """
        return np.array([self._misfit(read, k, k) for k in range(len(read.noise))])

    def table(self, read: Torques) -> Float:
        """Misfit (n, n) of each torque column (row) against each joint's expected torque (column)."""
        joints = range(len(read.noise))
        return np.array([[self._misfit(read, i, k) for k in joints] for i in joints])

    def misfit(self, read: Torques) -> float:
        """The mean misfit, each column weighted by the share of its torque that is not noise."""
        weights = read.shares()
        return float(np.sum(weights * np.minimum(self.misfits(read), MOST)) / max(np.sum(weights), 1e-12))

    def _misfit(self, read: Torques, column: int, joint: int) -> float:
        torque, noise = read.torque[:, column], read.noise[column]
        if deviation(torque) <= noise:
            return 0.0
        rest = torque - self.torque[:, joint]
        if not self.strict:
            speed = self.velocity[:, joint]
            ones = np.ones_like(speed)
            terms = np.column_stack([np.tanh(speed / STOPPED), speed, ones, -ones])
            rest = rest - terms @ nnls(terms, rest)[0]
        return _beyond(deviation(rest), noise) / _beyond(deviation(torque), noise)


@dataclass(frozen=True)
class Sample:
    """Some samples (N, n) of a run's motion and torque."""

    arm: Arm
    read: Torques
    motion: Plan

    def expected(self, factor: Float | float = 1.0, order: Sequence[int] | None = None) -> Expected:
        """Torque that the description predicts for this motion times ``factor``, with its columns in ``order``."""
        columns = slice(None) if order is None else list(order)
        q, qd, qdd = (np.asarray(part[:, columns] * factor, np.float64) for part in self.motion.courses)
        return Expected(self.arm.torque(q, qd, qdd), qd)


def sample_of(run: Run, motion: Moved, arm: Arm) -> Sample:
    """Evenly spread samples of a run, none of them filled in.

    Torques that were not read, or not together with the others, are 0 throughout: they support no interpretation of the
    columns.
    """
    rows = usable(run)
    recorded = np.isfinite(run.torque[rows])
    counts = recorded.sum(axis=0)
    # Joints that were hardly ever read together with the others are left out, the one with the fewest samples first.
    while counts.any() and recorded[:, counts > 0].all(axis=1).sum() < TOGETHER:
        counts[np.argmin(np.where(counts > 0, counts, len(rows) + 1))] = 0
    rows = rows[recorded[:, counts > 0].all(axis=1)]
    rows = rows[:: max(1, len(rows) // SAMPLES)]
    torque = np.where(counts > 0, run.torque[rows], 0.0)
    noise = MEAN_OF_NORMAL * np.nan_to_num(white_noise(run.torque))
    return Sample(arm, Torques(torque, noise), Plan(*(part[rows] for part in motion.courses)))


def _beyond(size: float, noise: float) -> float:
    """Root of the mean square in excess of the noise."""
    return float(np.sqrt(max(size**2 - noise**2, 0.0)))


def deviation(values: Float) -> float:
    """Mean absolute distance from the median; numpy's own median takes three times as long for so few values."""
    count = len(values)
    half = count // 2
    near = np.partition(values, [half - 1, half] if count % 2 == 0 else half)
    middle = near[half] if count % 2 else (near[half - 1] + near[half]) / 2
    return float(np.add.reduce(np.abs(values - middle)) / count)
