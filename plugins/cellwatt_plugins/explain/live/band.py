"""Difference of recording and simulation in one interval, and its permitted band."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.noise import floor
from cellwatt_plugins.explain.live.intake import Judged
from cellwatt_plugins.explain.live.settings import BandSettings

RECENT = 20
"""Intervals from which the noise floor is measured."""


@dataclass(frozen=True)
class IntervalResidual:
    """One channel in one interval, all in the channel's unit.

    ``residual`` is the root mean square of measured - simulated torque, or the absolute mean for the supply's power: a
    meter may lag, the energy of an interval does not. ``mean`` is the mean of measured - simulated, ``simulated`` the
    root mean square of the simulation, ``noise`` the noise floor.
    """

    channel: Judged
    residual: float
    mean: float
    simulated: float
    noise: float
    limit: float

    @property
    def outside(self) -> bool:
        """True if the channel is outside its band."""
        return self.residual > self.limit


@dataclass
class Band:
    """Computes the residuals of intervals, and stores the recent ones for the noise floor.

    Only moving joints are judged: at rest, friction may hold any torque. ``step`` is s from frame to frame.
    """

    settings: BandSettings
    channels: Sequence[Judged]
    step: float
    _recent: deque[Float] = field(default_factory=lambda: deque(maxlen=RECENT))

    def read(self, moving: Sequence[int], measured: Float, simulated: Float) -> list[IntervalResidual]:
        """Residuals of an interval in which the 1-based joints ``moving`` move.

        measured and simulated are (N, C), NaN where ``measured`` is missing.
        """
        residual = measured - simulated
        self._recent.append(residual)
        mean = _mean(residual)
        is_torque = np.array([c.joint is not None for c in self.channels])
        sizes = np.where(is_torque, np.sqrt(_mean(np.square(residual))), np.abs(mean))
        level = np.sqrt(np.mean(np.square(simulated), axis=0))
        noise = self._noise()
        limit = self.settings.noise * noise + self.settings.share * level
        return [
            IntervalResidual(c, *(float(x[i]) for x in (sizes, mean, level, noise, limit)))
            for i, c in enumerate(self.channels)
            if np.isfinite(sizes[i]) and (c.joint is None or c.joint in moving)
        ]

    def _noise(self) -> Float:
        """Noise floor (C,) of the recent intervals; 0 where a channel was not measured."""
        out = np.zeros(len(self.channels))
        for i in range(len(out)):
            parts = [part for r in self._recent if len(part := r[np.isfinite(r[:, i]), i : i + 1])]
            if parts:
                out[i] = floor(parts, [self.step] * len(parts))[0]
        return out


def _mean(values: Float) -> Float:
    """Mean (C,) of values (N, C) without missing ones; NaN if all are missing."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.asarray(np.divide(total, count, out=np.full(values.shape[1], np.nan), where=count > 0))
