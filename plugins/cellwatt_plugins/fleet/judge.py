"""Statements about courses that are sure, at a chance of a false one that holds for the whole fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from cellwatt_plugins.fleet.adjusted import Course
from cellwatt_plugins.fleet.courses import Courses, Place
from cellwatt_plugins.fleet.kinds import FEWEST, Common, common_course, less_common
from cellwatt_plugins.fleet.slopes import Trend, trends_of
from cellwatt_plugins.fleet.trend import Step, bends, line, persistence, steps_in

Float = NDArray[np.float64]

SHARES: Final = {"friction": 0.6, "energy": 0.2, "load": 0.2}
"""Shares of the chance of a false statement; steps have half of each."""
LONG_ENOUGH: Final = 6
"""Weeks of a course, at least."""
LEAST_LOAD: Final = 0.3
"""kg below which no change of load is told."""
BENT: Final = 3.0
"""Errors of its curvature from which a course is no line that may be drawn on."""


@dataclass(frozen=True)
class Judged:
    """Courses of a quantity of one kind, with what is common taken out, and what is sure about them."""

    courses: Courses
    common: Mapping[int, Common | None]
    """By joint."""
    own: Mapping[Place, Course]
    steps: Mapping[Place, Sequence[Step]]
    trends: Mapping[Place, Trend]
    rho: float
    sure: frozenset[Place]
    """Places whose trend is sure."""
    since: Mapping[Place, int]
    """First week of which that is so."""
    alone: bool
    """True where the kind has too few arms to tell what is common."""
    smallest: float
    """Slope a week that half the joints would show; NaN where there are none."""


def judged(groups: Sequence[Courses], chance: float, least: float) -> list[Judged]:
    """Judge all courses of a fleet at a ``chance`` of one false statement in all; less than ``least`` is not told."""
    out = []
    for quantity in SHARES:
        every = [_prepared(group) for group in groups if group.quantity == quantity]
        out += _judged_together(every, SHARES[quantity] * chance, least)
    return out


@dataclass(frozen=True)
class _Prepared:
    group: Courses
    common: Mapping[int, Common | None]
    own: Mapping[Place, Course]
    alone: bool


def _prepared(group: Courses) -> _Prepared:
    common, own = {}, {}
    for joint in sorted({place.joint for place in group.by_place}):
        those = {place: course for place, course in group.by_place.items() if place.joint == joint}
        common[joint] = shared = common_course(those)
        for place, course in those.items():
            left = course if shared is None else less_common(course, shared)
            if len(left.weeks) >= LONG_ENOUGH:
                own[place] = left
    return _Prepared(group, common, own, group.cells < FEWEST)


def _judged_together(every: Sequence[_Prepared], chance: float, least: float) -> list[Judged]:
    """One quantity in all kinds: one correlation from week to week, and one chance of a false statement."""
    if not every:
        return []
    floor = LEAST_LOAD if every[0].group.quantity == "load" else least
    rho = persistence([course for each in every for course in each.own.values()])
    count = max(sum(len(each.own) for each in every), 1)
    level = chance / 2 / count
    steps = [_steps(each, rho, level, floor) for each in every]
    lined = [trends_of(each.own, each_steps, rho) for each, each_steps in zip(every, steps, strict=True)]
    clear = _holm([trend for trends in lined for trend in trends.values()], chance / 2)
    out = []
    for each, each_steps, trends in zip(every, steps, lined, strict=True):
        change = each.group.change
        own = frozenset(p for p, t in trends.items() if p in clear and abs(change(t.slope * t.span)) >= floor)
        since = _since(each.own, each_steps, rho, {p: trends[p].slope > 0 for p in own}, level)
        smallest = _smallest(trends, level)
        out.append(Judged(each.group, each.common, each.own, each_steps, trends, rho, own, since, each.alone, smallest))
    return out


def _steps(each: _Prepared, rho: float, chance: float, floor: float) -> dict[Place, list[Step]]:
    """Steps of a kind's arms; weeks of one arm are not calmer than those of half the others."""
    scatters = [found.scatter for course in each.own.values() if (found := line(course, rho)) is not None]
    usual = 0.0 if each.alone or not scatters else float(np.median(scatters))
    return {
        place: [s for s in steps_in(course, rho, chance, usual) if abs(each.group.change(s.size)) >= floor]
        for place, course in each.own.items()
    }


def _smallest(trends: Mapping[Place, Trend], chance: float) -> float:
    """Slope that half the joints would show at a ``chance`` of a false one in each."""
    return float(np.median([-float(stdtrit(t.free, chance / 2)) * t.error for t in trends.values()] or [np.nan]))


def _holm(trends: Sequence[Trend], chance: float) -> set[Place]:
    """Places whose trends are sure by Holm's step-down."""
    out: set[Place] = set()
    for i, trend in enumerate(sorted(trends, key=lambda each: each.chance)):
        if trend.chance * (len(trends) - i) > chance:
            break
        out.add(trend.place)
    return out


def _since(
    own: Mapping[Place, Course],
    steps: Mapping[Place, Sequence[Step]],
    rho: float,
    sure: Mapping[Place, bool],
    chance: float,
) -> dict[Place, int]:
    """First week up to which the data were enough, and in each one after it; ``sure``: true where it rises."""
    if not sure:
        return {}
    weeks = sorted({int(week) for course in own.values() for week in course.weeks}, reverse=True)
    out = dict.fromkeys(sure, weeks[0])
    open_places = set(sure)
    for week in weeks[1:]:
        if not open_places:
            break
        known = {p: course.part(course.weeks <= week) for p, course in own.items()}
        known = {p: course for p, course in known.items() if len(course.weeks) >= LONG_ENOUGH}
        before = {p: [s for s in steps[p] if s.week <= week] for p in known}
        trends = trends_of(known, before, rho)
        for place in sorted(open_places):
            trend = trends.get(place)
            if trend is not None and trend.chance <= chance and (trend.slope > 0) == sure[place]:
                out[place] = week
            else:
                open_places.discard(place)
    return out


def straight(each: Judged, place: Place) -> bool:
    """Return true where a course may be drawn on: it has no step, and does not bend."""
    return not each.steps[place] and abs(bends(each.own[place], each.rho)) < BENT
