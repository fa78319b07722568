"""Recognises a slow meter's power in the rows of a faster recording, where each value is held until the next one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.meter.model import Readings

SHORTEST: Final = 2
"""Fewest rows for which nearly every value is held, if the meter is slower than the rows."""
SELDOM: Final = 0.1
"""Largest share of values that are held for fewer rows."""
SAME: Final = 1e-7
"""Smallest difference of two values, as a share of the power's range."""
IRREGULAR: Final = 0.1
"""Largest mean deviation of the times of values, in intervals; by chance it would be a quarter."""
COARSE: Final = 0.25
"""Step of the rows, in intervals, above which they do not show whether values come regularly."""
FEWEST: Final = 8
"""Fewest changes that are judged."""
EVEN: Final = 1.0
"""Largest deviation of values from a meter's regular beat, in rows: rows show a value with such a delay."""


def held(segments: Sequence[tuple[Float, Float]], interval: float | None = None) -> list[Readings] | None:
    """The values of a slow meter, for each segment of rows: times (N,) s, evenly spaced, and power (N,) W.

    A value counts from the row in which it first appears; the first value of a segment is left out, as its time is
    unknown. None if the power is from a meter as fast as the rows, or not from one of the known ``interval`` s.
    """
    changes = [_changes(power) for _, power in segments]
    lasting = np.concatenate([np.empty(0), *(np.diff(each) for each in changes)])
    if not _lasts(lasting) or (interval is None and len(lasting) < FEWEST):
        return None
    if interval is None:
        step = float(np.median(np.concatenate([np.diff(time) for time, _ in segments])))
        interval = _interval([time[each] for (time, _), each in zip(segments, changes, strict=True)], step)
        if not _regular(lasting * step / interval, step / interval):
            return None
    pairs = zip(segments, changes, strict=True)
    return [_on_beat(time, power, each, interval) for (time, power), each in pairs]


def onto(when: Float, time: Float, power: Float) -> Float:
    """Power (N,) at ``time`` (N,) s brought to times ``when`` (M,) s: (M,).

    It is interpolated; a slow meter's last value is held, as the meter never gave a value between two of its own.
    """
    lasting = np.diff(_changes(power))
    if len(lasting) < FEWEST or not _lasts(lasting):
        return np.asarray(np.interp(when, time, power))
    rounding = 1e-3 * float(np.median(np.diff(time)))
    return power[np.maximum(np.searchsorted(time, when + rounding, side="right") - 1, 0)]


def _lasts(rows: NDArray[np.intp]) -> bool:
    """True if values that last for these numbers of rows (M,) are those of a meter slower than the rows."""
    return not len(rows) or float(np.mean(rows < SHORTEST)) <= SELDOM


def _regular(lasting: Float, row: float) -> bool:
    """True if values last for whole intervals, not until the power has changed by a step of a coarse meter.

    ``lasting`` (M,) and the step of a ``row`` are in intervals.
    """
    off = np.abs(lasting - np.round(lasting))
    return row > COARSE or float(np.mean(off)) < IRREGULAR + row / 2


def _changes(power: Float) -> NDArray[np.intp]:
    """Rows whose value differs from the row before by more than interpolation between equal values causes."""
    return np.flatnonzero(np.abs(np.diff(power)) > SAME * np.ptp(power)) + 1


def _interval(times: Sequence[Float], step: float) -> float:
    """s from one value to the next: the beat that all changes are multiples of, as values may repeat."""
    gaps = np.concatenate([np.diff(each) for each in times])
    interval = float(np.median(gaps))
    for _ in range(3):
        counts, spans = 0.0, 0.0
        for each in times:
            if len(each) < 2:
                continue
            number = np.cumsum(np.maximum(1, np.round(np.diff(each) / interval)))
            # Slope of the least squares line through the times of the values, all segments together.
            x, y = np.concatenate([[0.0], number]), each - each[0]
            x, y = x - x.mean(), y - y.mean()
            counts, spans = counts + float(x @ x), spans + float(x @ y)
        interval = max(spans / counts, step)
    return interval


def _on_beat(time: Float, power: Float, changes: NDArray[np.intp], interval: float) -> Readings:
    """The values of a segment; the beat, if there is one, shows those that repeat the value before."""
    if not len(changes):
        return Readings(np.empty(0), np.empty(0), interval)
    step = float((time[-1] - time[0]) / (len(time) - 1))
    seen = time[changes] - step / 2  # it came between this row and the one before
    number = np.concatenate([[0.0], np.cumsum(np.maximum(1, np.round(np.diff(seen) / interval)))])
    first = float(np.mean(seen - number * interval))
    if np.abs(seen - first - number * interval).max() > EVEN * step:
        return Readings(seen, power[changes], interval)
    came = first + interval * np.arange(number[-1] + 1)
    rows = np.clip(np.searchsorted(time, came + step), 0, len(time) - 1)
    values = power[rows]
    values[number.astype(np.intp)] = power[changes]
    return Readings(came, values, interval)
