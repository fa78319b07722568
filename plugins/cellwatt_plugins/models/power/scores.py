"""Errors of predictions: energy of each move, power, currents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.shown import readings_of


@dataclass(frozen=True)
class Score:
    """Errors of predictions."""

    energy: tuple[float | None, ...]
    """Error in % of each move's energy (equation 14); None if power was not measured."""
    power: float | None
    """Root mean square error, W."""
    current: tuple[float | None, ...]
    """Root mean square error of each joint's current, as a share of the current's standard deviation."""
    current_rms: tuple[float | None, ...]
    """The same in A."""

    @property
    def energy_mean(self) -> float | None:
        """Mean error of a move's energy, %."""
        known = [each for each in self.energy if each is not None]
        return float(np.mean(known)) if known else None

    @property
    def energy_worst(self) -> float | None:
        """Largest error of a move's energy, %."""
        return max((each for each in self.energy if each is not None), default=None)

    @classmethod
    def of(cls, moves: Moves, power: Float, current: Float) -> Score:
        """Errors of predicted power (N,) W and currents (N, n) A."""
        pairs = [_compared(moves, power, a, b) for a, b in moves.bounds()]
        energy = tuple(_energy_error(measured, predicted) for measured, predicted in pairs)
        rms_power = _rms(np.concatenate([predicted - measured for measured, predicted in pairs]))
        rms = tuple(_rms(each) for each in (current - moves.current).T)
        spread = [_rms(each - np.nanmean(each)) if np.isfinite(each).any() else None for each in moves.current.T]
        relative = tuple(None if r is None or not s else r / s for r, s in zip(rms, spread, strict=True))
        return cls(energy, rms_power, relative, rms)


def _compared(moves: Moves, power: Float, first: int, end: int) -> tuple[Float, Float]:
    """Measured and predicted power of one move: row by row, or as means over a slow meter's windows."""
    if moves.meter is None:
        return moves.power[first:end], power[first:end]
    time = moves.time[first:end]
    windows, shown = moves.meter.within(readings_of(moves, first, end), time)
    return shown, windows.means(time, power[first:end])


def _energy_error(measured: Float, predicted: Float) -> float | None:
    known = np.isfinite(measured) & np.isfinite(predicted)
    if not known.any() or measured[known].sum() == 0:
        return None
    return float(100 * abs(predicted[known].sum() / measured[known].sum() - 1))


def _rms(values: Float) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else None
