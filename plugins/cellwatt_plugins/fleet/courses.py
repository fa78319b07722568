"""Weekly courses of all cells: friction of each joint, and energy of the arm."""

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
"""Standard deviation of the logarithm of each quantity between programs of a cell."""
UNKNOWN: Final = 0.01
"""Scatter of recordings within a week if no week has several; the scatter between weeks covers the rest."""


@dataclass(frozen=True, order=True)
class CellJoint:
    """A joint (1-based) of a cell, or 0 for the whole arm."""

    cell: str
    joint: int


@dataclass(frozen=True)
class Courses:
    """Comparable courses of one quantity of the arms of one kind."""

    kind: str
    quantity: str
    with_temperature: bool
    """True if friction is converted to one temperature."""
    by_place: Mapping[CellJoint, Course]

    @property
    def cells(self) -> int:
        """Number of arms."""
        return len({place.cell for place in self.by_place})


def _usual_speed(weeks: Sequence[Week]) -> Float:
    """Return the speed (n,) rad/s for which friction is reported, the median of the weeks; NaN if unknown."""
    speeds = np.array([week.speed for week in weeks])
    known = np.isfinite(speeds)
    return np.array([np.median(s[k]) if k.any() else np.nan for s, k in zip(speeds.T, known.T, strict=True)])


def observations_of(weeks: Sequence[Week]) -> dict[tuple[str, int], Observations]:
    """Return the values of the repetitions of one cell, by quantity and joint (1-based; 0: the whole arm).

    A joint that hardly moves has no values.
    """
    speed = _usual_speed(weeks)
    pairs = [(week, repetition) for week in weeks for repetition in week.repetitions]
    number = programs([repetition.signature for _, repetition in pairs])
    week = np.array([week.week for week, _ in pairs])
    # A week has fewer than 1,000,000 recordings of 1 s.
    recording = np.array([1_000_000 * week.week + repetition.recording for week, repetition in pairs])
    heat = None
    if pairs and all(repetition.temperature is not None for _, repetition in pairs):
        heat = np.array([repetition.temperature for _, repetition in pairs])

    def observed(logs: Sequence[float], joint: int | None = None) -> Observations:
        warmth = None if heat is None or joint is None else heat[:, joint]
        return Observations(np.array(logs, np.float64), week, recording, number, warmth).by_recording()

    out = {("energy", 0): observed([_log(each.energy) for _, each in pairs])}
    for i in range(len(speed)):
        logs = [_log((w.coulomb[i] + w.viscous[i] * speed[i]) * each.friction[i]) for w, each in pairs]
        out["friction", i + 1] = observed(logs, i)
    return {key: each for key, each in out.items() if len(each.values)}


def courses_of_kind(kind: str, observed: Mapping[str, Mapping[tuple[str, int], Observations]]) -> list[Courses]:
    """Return the courses of the arms of a kind, with the effect of temperature removed.

    Friction of arms with known joint temperatures is converted to one temperature; other arms form a separate group.
    """
    by_quantity: dict[tuple[str, bool], dict[CellJoint, Course]] = {}
    heat = [each.warmth for cell in observed.values() for each in cell.values() if each.warmth is not None]
    warm = float(np.median(np.concatenate(heat))) if heat else float("nan")
    for quantity, joint in sorted({key for cell in observed.values() for key in cell}):
        every = {
            CellJoint(name, joint): cell[quantity, joint]
            for name, cell in observed.items()
            if (quantity, joint) in cell
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
