"""Recognises the power of a slow meter in the rows of a faster recording: each of its values is held until the next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot.meter.model import Readings

SHORTEST: Final = 2
"""Rows that nearly every value is held for at least, where the meter is slower than the rows."""
SELDOM: Final = 0.1
"""Share of values that may be held for less."""
SAME: Final = 1e-7
"""Share of the power's range by which two values differ at least."""
IRREGULAR: Final = 0.1
"""Share of an interval by which values come early or late on average, at most; by chance it would be a quarter."""
COARSE: Final = 0.25
"""Rows that are a larger share of the interval do not show whether values come regularly."""
FEWEST: Final = 8
"""Changes from which something can be said."""
EVEN: Final = 1.0
"""Rows by which values of a meter with a beat of its own come off that beat, at most: rows see it with such a delay."""


def held(segments: Sequence[tuple[Float, Float]], interval: float | None = None) -> list[Readings] | None:
    """The values of a slow meter, for each segment of rows: times (N,) s, evenly spaced, and power (N,) W.

    A value counts from the row that it is first seen in; the one that a segment begins with is left out, as nobody
    saw when it came. None where power is a meter's that is as fast as the rows, or not one of the ``interval`` s that
    is known.
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

    Interpolated; of a slow meter the last value, as a value between two of its own is one that it never showed.
    """
    lasting = np.diff(_changes(power))
    if len(lasting) < FEWEST or not _lasts(lasting):
        return np.asarray(np.interp(when, time, power))
    rounding = 1e-3 * float(np.median(np.diff(time)))
    return power[np.maximum(np.searchsorted(time, when + rounding, side="right") - 1, 0)]


def _lasts(rows: NDArray[np.intp]) -> bool:
    """True if values that last for so many rows (M,) each are those of a meter slower than the rows."""
    return not len(rows) or float(np.mean(rows < SHORTEST)) <= SELDOM


def _regular(lasting: Float, row: float) -> bool:
    """True if values last for whole intervals, not until the power has gone a step of a coarse meter.

    In intervals (M,), of which a ``row`` is a share.
    """
    off = np.abs(lasting - np.round(lasting))
    return row > COARSE or float(np.mean(off)) < IRREGULAR + row / 2


def _changes(power: Float) -> NDArray[np.intp]:
    """Rows with another value than the row before, but for what interpolation between equal times makes of it."""
    return np.flatnonzero(np.abs(np.diff(power)) > SAME * np.ptp(power)) + 1


def _interval(times: Sequence[Float], step: float) -> float:
    """s from one value to the next: the beat that all changes are multiples of, values that repeat among them."""
    gaps = np.concatenate([np.diff(each) for each in times])
    interval = float(np.median(gaps))
    for _ in range(3):
        counts, spans = 0.0, 0.0
        for each in times:
            if len(each) < 2:
                continue
            number = np.cumsum(np.maximum(1, np.round(np.diff(each) / interval)))
            # Slope of the least squares line through when each came, all segments together.
            x, y = np.concatenate([[0.0], number]), each - each[0]
            x, y = x - x.mean(), y - y.mean()
            counts, spans = counts + float(x @ x), spans + float(x @ y)
        interval = max(spans / counts, step)
    return interval


def _on_beat(time: Float, power: Float, changes: NDArray[np.intp], interval: float) -> Readings:
    """The values of a segment; those that repeat the one before are told by the beat, where there is one."""
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
