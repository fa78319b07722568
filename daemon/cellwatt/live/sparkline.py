"""A course of values as one line of bars. Pure."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

BARS: Final = "▁▂▃▄▅▆▇█"


def parts(
    time: NDArray[np.int64], values: NDArray[np.float64], start: int, end: int, count: int
) -> NDArray[np.float64]:
    """Means (count,) of the values in equal parts of ``start`` … ``end`` ns, NaN where there is none."""
    known = np.isfinite(values)
    at = (time[known] - start) * count // max(1, end - start + 1)
    inside = (at >= 0) & (at < count)
    number = np.bincount(at[inside], minlength=count)
    total = np.bincount(at[inside], values[known][inside], minlength=count)
    means: NDArray[np.float64] = np.divide(total, number, out=np.full(count, np.nan), where=number > 0)
    return means


def bars(values: Iterable[float], low: float, high: float) -> str:
    """One bar a value between two limits; blank where it is NaN."""
    step = (len(BARS) - 1) / ((high - low) or 1.0)
    return "".join(" " if value != value else BARS[round((value - low) * step)] for value in values)
