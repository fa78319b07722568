"""Times in two columns: whole seconds, and their fraction in a unit of its own."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import Final

import numpy as np

from cellwatt.arrays import Float

_SECONDS: Final = re.compile(r"(?P<before>.*?)[\s_./]*(?:secs?(?:onds?)?|(?<=[\s_./])s)", re.IGNORECASE)
_FRACTION: Final = re.compile(
    r"(?P<before>.*?)[\s_./(\[]*(?P<unit>n|u|m|nano|micro|milli)_?s(?:ecs?(?:onds?)?)?[)\]]?", re.IGNORECASE
)
_UNITS: Final = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "nano": 1e-9, "micro": 1e-6, "milli": 1e-3}


def joined(values: dict[str, Float], clocks: Collection[str]) -> tuple[str, ...]:
    """Add fractions to their seconds, as in ``stamp.sec, stamp.nanosec`` or ``Time, Time (ms)``; return the clocks.

    ``clocks`` are the columns of times of day, ``values`` (N,) all columns; those of fractions are removed.
    """
    found = list(clocks)
    for name in list(values):
        if (fraction := _FRACTION.fullmatch(name)) is None:
            continue
        whole, unit = _whole(fraction["before"], name, values, clocks), _UNITS[fraction["unit"].casefold()]
        if whole is not None and _counts(values[name], round(1 / unit)) and _counts(values[whole]):
            values[whole] = values[whole] + unit * values.pop(name)
            found += [] if whole in found else [whole]
    return tuple(found)


def _whole(before: str, name: str, values: Collection[str], clocks: Collection[str]) -> str | None:
    """Name of the column of seconds that belongs to a fraction ``name``, whose unit follows ``before``."""
    for other in values:
        seconds = _SECONDS.fullmatch(other)
        if other != name and seconds is not None and seconds["before"] == before:
            return other
    if before in clocks:
        return before
    return next(iter(clocks)) if not before and len(clocks) == 1 else None


def _counts(values: Float, below: float = np.inf) -> bool:
    """True for whole numbers from 0 on, all less than ``below``."""
    known = values[np.isfinite(values)]
    return bool(len(known) and np.all((known == np.round(known)) & (known >= 0) & (known < below)))
