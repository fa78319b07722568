"""Courses of all cells: friction of each joint, and energy of the arm, by week."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.fleet.adjusted import UNTOUCHED, Course, Observations, apart, course_of, shrunk, warmth_of
from cellwatt_plugins.fleet.repetitions import programs
from cellwatt_plugins.fleet.weekly import Week

PROGRAMS: Final = {"friction": 0.05, "energy": 1.0}
"""Quantities, as logs: standard deviation by which programs of a cell differ in it."""
UNKNOWN: Final = 0.01
"""By which recordings of a week are apart where no week has several; weeks tell the rest by their own scatter."""


@dataclass(frozen=True, order=True)
class CellJoint:
    """A joint of a cell, or 0 for the whole arm."""

    cell: str
    joint: int


@dataclass(frozen=True)
class Courses:
    """Courses of one quantity of the arms of one kind that can be compared."""

    kind: str
    quantity: str
    with_temperature: bool
    """True where friction is brought to one temperature."""
    by_place: Mapping[CellJoint, Course]

    @property
    def cells(self) -> int:
        """Number of arms."""
        return len({place.cell for place in self.by_place})


def _usual_speed(weeks: Sequence[Week]) -> Float:
    """Return the speed (n,) rad/s at which friction is told, the median of the weeks; NaN where none is known."""
    speeds = np.array([week.speed for week in weeks])
    known = np.isfinite(speeds)
    return np.array([np.median(s[k]) if k.any() else np.nan for s, k in zip(speeds.T, known.T, strict=True)])


def told_of(weeks: Sequence[Week]) -> dict[tuple[str, int], Observations]:
    """Return what the repetitions of one cell say, by quantity and joint (from 1; of the whole arm: 0).

    A joint that hardly moves says nothing.
    """
    speed = _usual_speed(weeks)
    pairs = [(week, repetition) for week in weeks for repetition in week.repetitions]
    number = programs([repetition.signature for _, repetition in pairs])
    week = np.array([week.week for week, _ in pairs])
    recording = np.array([1000 * week.week + repetition.recording for week, repetition in pairs])
    heat = None
    if pairs and all(repetition.temperature is not None for _, repetition in pairs):
        heat = np.array([repetition.temperature for _, repetition in pairs])

    def told(logs: Sequence[float], joint: int | None = None) -> Observations:
        warmth = None if heat is None or joint is None else heat[:, joint]
        return Observations(np.array(logs, np.float64), week, recording, number, warmth).by_recording()

    out = {("energy", 0): told([_log(each.energy) for _, each in pairs])}
    for i in range(len(speed)):
        logs = [_log((w.coulomb[i] + w.viscous[i] * speed[i]) * each.friction[i]) for w, each in pairs]
        out["friction", i + 1] = told(logs, i)
    return {key: each for key, each in out.items() if len(each.values)}


def courses_of_kind(kind: str, told: Mapping[str, Mapping[tuple[str, int], Observations]]) -> list[Courses]:
    """Return the courses of the arms of a kind from what each cell tells, with temperature taken out.

    Friction of arms whose joints tell their temperature is brought to one; the others are a group of their own.
    """
    by_quantity: dict[tuple[str, bool], dict[CellJoint, Course]] = {}
    heat = [each.warmth for cell in told.values() for each in cell.values() if each.warmth is not None]
    warm = float(np.median(np.concatenate(heat))) if heat else float("nan")
    for quantity, joint in sorted({key for cell in told.values() for key in cell}):
        every = {
            CellJoint(name, joint): cell[quantity, joint] for name, cell in told.items() if (quantity, joint) in cell
        }
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


def _log(value: float | None) -> float:
    return float(np.log(value)) if value is not None and value > 0 else float("nan")
