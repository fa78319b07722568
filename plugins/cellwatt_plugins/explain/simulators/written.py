"""Record of the numbers written into a simulator's file, and of the effects that could not be written."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cellwatt.arrays import Float
from cellwatt_plugins.explain.simulators.inertia import at_centre
from cellwatt_plugins.explain.simulators.markup import Element

SMALL = 1e-9
"""Relative change of a number above which it is written."""
INERTIAL = (("mass", "kg"), ("centre of mass", "m"), ("inertia (xx yy zz xy xz yz)", "kg*m^2"))
"""The results of ``at_centre``, with their units."""


def differ(values: Float, were: Float) -> bool:
    """True if the numbers of one body differ, rounding aside."""
    return bool(np.max(np.abs(values - were)) > SMALL * np.max(np.abs([values, were])))


@dataclass(frozen=True)
class Applied:
    """A number that was written."""

    what: str
    """The attribute, e.g. ``frictionloss``."""
    where: str
    """The element, e.g. ``joint elbow``."""
    value: float | tuple[float, ...]
    was: float | tuple[float, ...] | None
    """The user's value; None if the file had none."""
    unit: str


@dataclass
class Written:
    """The changes of one file and of those that it includes."""

    files: Sequence[Path] = ()
    """The files written, the main file first."""
    applied: list[Applied] = field(default_factory=list)
    refused: list[tuple[str, int | None, str]] = field(default_factory=list)
    """Effects with their joints (0-based) that this kind of file cannot hold, and why."""

    @property
    def path(self) -> Path:
        """The main file."""
        return self.files[0]

    def record(self, what: str, where: str, value: ArrayLike, was: ArrayLike | None, unit: str) -> None:
        """Record a written value of one or several numbers, and the user's value ``was``."""
        self.applied.append(Applied(what, where, _numbers(value), None if was is None else _numbers(was), unit))

    def record_inertial(self, new: Float, own: Float | None, where: str) -> None:
        """Record mass, centre and inertia of a ``new`` body (10,); ``own`` (10,) is the user's body."""
        now: Sequence[ArrayLike] = at_centre(new)
        before: Sequence[ArrayLike | None] = [None] * len(now) if own is None or own[0] <= 0 else at_centre(own)
        for (what, unit), value, was in zip(INERTIAL, now, before, strict=True):
            self.record(what, where, value, was, unit)


def _numbers(value: ArrayLike) -> float | tuple[float, ...]:
    numbers = np.asarray(value, np.float64)
    return tuple(numbers.tolist()) if numbers.ndim else float(numbers)


def differs(value: float, was: float) -> bool:
    """True if a number differs, rounding aside; a finite number differs from an infinite one."""
    return math.isfinite(value) and not math.isclose(value, was, rel_tol=SMALL, abs_tol=1e-12 * SMALL)


def write_inertial(body: Element, text: str) -> None:
    """Write ``text`` as the inertia of a body, in place of an inertia that it has."""
    existing = body.child("inertial")
    if existing is None:
        body.added.append(text)
    else:
        existing.instead = text


def free_name(name: str, taken: Collection[str]) -> str:
    """``name``, numbered if it is in ``taken``."""
    names = (name, *(f"{name}_{i}" for i in range(2, 101)))
    return next(name for name in names if name not in taken)
