"""Record of what was written into a simulator's file, and what could not be."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.simulators.inertia import at_centre

Float = NDArray[np.float64]

SMALL = 1e-9
"""Share of a number by which it must change to be written."""


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
    """The user's value; None where there was none."""
    unit: str


@dataclass
class Written:
    """The changes of one file."""

    path: Path
    applied: list[Applied] = field(default_factory=list)
    refused: list[tuple[str, int | None, str]] = field(default_factory=list)
    """Effects with their joints (0-based) that this kind of file cannot hold, and why."""


def differs(value: float, was: float) -> bool:
    """True if a number differs, rounding aside."""
    return abs(value - was) > SMALL * max(abs(value), abs(was), 1e-12)


def say_inertial(new: Float, own: Float | None, where: str, done: Written) -> None:
    """Notes mass, centre and inertia of a body (10,) that was ``own`` (10,) before."""
    mass, centre, inertia = at_centre(new)
    before = None if own is None or own[0] <= 0 else at_centre(own)
    order = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
    done.applied += [
        Applied("mass", where, mass, before[0] if before else None, "kg"),
        Applied("centre of mass", where, tuple(centre.tolist()), tuple(before[1].tolist()) if before else None, "m"),
        Applied(
            "inertia (xx yy zz xy xz yz)",
            where,
            tuple(inertia[order].tolist()),
            tuple(before[2][order].tolist()) if before else None,
            "kg*m^2",
        ),
    ]
