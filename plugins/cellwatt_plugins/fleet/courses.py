"""Courses of all cells: friction of each joint, and energy of the arm, by week."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.fleet.adjusted import UNTOUCHED, Course, Told, apart, course_of, shrunk, warmth_of
from cellwatt_plugins.fleet.repetitions import programs
from cellwatt_plugins.fleet.weekly import Repetition, Week

Float = NDArray[np.float64]

PROGRAMS: Final = {"friction": 0.05, "energy": 1.0}
"""Quantities, as logs: standard deviation by which programs of a cell differ in it."""
UNKNOWN: Final = 0.01
"""By which recordings of a week are apart where no week has several; weeks tell the rest by their own scatter."""


@dataclass(frozen=True, order=True)
class Place:
    """A joint of a cell, or 0 for the whole arm."""

    cell: str
    joint: int


@dataclass(frozen=True)
class Usual:
    """A cell's joints at their usual speed, (n,) each."""

    speed: Float
    """rad/s."""
    coulomb: Float
    """Nm, the median of the weeks."""
    viscous: Float
    """Nm s/rad, likewise."""


@dataclass(frozen=True)
class Courses:
    """Courses of one quantity of the arms of one kind that can be compared."""

    kind: str
    quantity: str
    with_temperature: bool
    """True where friction is brought to one temperature."""
    by_place: Mapping[Place, Course]

    @property
    def cells(self) -> int:
        """Number of arms."""
        return len({place.cell for place in self.by_place})


def usual_of(weeks: Sequence[Week]) -> Usual:
    """Return a cell's usual speed, and its friction there. Weeks that hold nothing are passed over."""
    columns = [known_median(np.array([getattr(w, name) for w in weeks])) for name in ("speed", "coulomb", "viscous")]
    return Usual(*columns)


def told_of(weeks: Sequence[Week], usual: Usual) -> dict[tuple[str, int], Told]:
    """Return what the repetitions of one cell say, by quantity and joint (from 1; of the whole arm: 0)."""
    pairs = [(week, repetition) for week in weeks for repetition in week.repetitions]
    number = programs([repetition.signature for _, repetition in pairs])
    week = np.array([week.week for week, _ in pairs])
    recording = np.array([1000 * week.week + repetition.recording for week, repetition in pairs])
    heat = None
    if pairs and all(repetition.temperature is not None for _, repetition in pairs):
        heat = np.array([repetition.temperature for _, repetition in pairs])

    def told(value: Callable[[Week, Repetition], float], joint: int | None = None) -> Told:
        values = np.array([value(*pair) for pair in pairs], np.float64)
        warmth = None if heat is None or joint is None else heat[:, joint]
        return Told(values, week, recording, number, warmth).by_recording()

    out = {("energy", 0): told(lambda _, each: _log(each.energy))}
    for i in range(len(usual.speed)):
        out["friction", i + 1] = told(lambda w, each, i=i: _log(_level(w, usual, i) * each.friction[i]), i)  # type: ignore[misc]
    return {key: each for key, each in out.items() if len(each.values)}


def courses_of_kind(kind: str, told: Mapping[str, Mapping[tuple[str, int], Told]]) -> list[Courses]:
    """Return the courses of the arms of a kind from what each cell tells, with temperature taken out.

    Friction of arms whose joints tell their temperature is brought to one; the others are a group of their own.
    """
    by_quantity: dict[tuple[str, bool], dict[Place, Course]] = {}
    heat = [each.warmth for cell in told.values() for each in cell.values() if each.warmth is not None]
    warm = float(np.median(np.concatenate(heat))) if heat else float("nan")
    for quantity, joint in sorted({key for cell in told.values() for key in cell}):
        every = {Place(name, joint): cell[quantity, joint] for name, cell in told.items() if (quantity, joint) in cell}
        noises = [apart(each, PROGRAMS[quantity]) for each in every.values()]
        known = [noise for noise in noises if np.isfinite(noise)]
        usual = float(np.median(known)) if known else UNKNOWN
        warmer = {place: each for place, each in every.items() if each.warmth is not None}
        found = shrunk([warmth_of(each, PROGRAMS[quantity]) for each in warmer.values()])
        own = dict(zip(warmer, found, strict=True))
        for place, each in every.items():
            slope = own.get(place, UNTOUCHED)
            course = course_of(each, PROGRAMS[quantity], usual, slope, warm)
            by_quantity.setdefault((quantity, slope.slope != 0.0), {})[place] = course
    return [Courses(kind, quantity, heated, by) for (quantity, heated), by in sorted(by_quantity.items())]


def _level(week: Week, usual: Usual, joint: int) -> float:
    return float(week.coulomb[joint] + week.viscous[joint] * usual.speed[joint])


def _log(value: float | None) -> float:
    return float(np.log(value)) if value is not None and value > 0 else float("nan")


def known_median(table: Float) -> Float:
    """Median (n,) of the rows of ``table`` (W, n) that are known; NaN where none is."""
    known = np.isfinite(table)
    return np.array([np.median(c[k]) if k.any() else np.nan for c, k in zip(table.T, known.T, strict=True)])
