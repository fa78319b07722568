"""Statements about courses that are sure, at a chance of a false one that holds for the whole fleet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from cellwatt_plugins.fleet.adjusted import Course
from cellwatt_plugins.fleet.courses import Courses, Place
from cellwatt_plugins.fleet.kinds import FEWEST, Common, common_course, joint_freedom, less_common, moderated, spread_of
from cellwatt_plugins.fleet.trend import Line, Step, bends, line, persistence, steps_in

Float = NDArray[np.float64]

SHARES: Final = {"friction": 0.6, "energy": 0.2, "load": 0.2}
"""Shares of the chance of a false statement; steps have half of each."""
LONG_ENOUGH: Final = 6
"""Weeks of a course, at least."""
LEAST_LOAD: Final = 0.3
"""kg below which no change of load is told."""
USUAL: Final = 5.0
"""Errors that a slope must be away from 0 in a fleet of 50 arms, about."""
BENT: Final = 3.0
"""Errors of its curvature from which a course is no line that may be drawn on."""


@dataclass(frozen=True)
class Trend:
    """A line of one arm against its kind."""

    place: Place
    line: Line
    slope: float
    """A week, beyond the median of the kind."""
    error: float
    free: float
    chance: float

    @property
    def span(self) -> int:
        """Weeks from the first to the last."""
        return self.line.last - self.line.first

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the ends of the interval of the slope."""
        wide = float(student.ppf((1 + level) / 2, self.free)) * self.error
        return self.slope - wide, self.slope + wide


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
    spread: float
    """Standard deviation a week by which slopes of sound arms differ."""
    sure: frozenset[Place]
    """Places whose trend is sure."""
    since: Mapping[Place, int]
    """First week of which that is so."""
    alone: bool
    """True where the kind has too few arms to tell what is common."""

    @property
    def smallest(self) -> float:
        """Slope a week that half the arms would show; NaN where there are none."""
        return float(np.median([t.error * USUAL for t in self.trends.values()])) if self.trends else float("nan")


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
    steps = [_steps(each, rho, chance / 2 / count, floor) for each in every]
    lined = [_trends(each.own, each_steps, rho) for each, each_steps in zip(every, steps, strict=True)]
    clear = _holm([trend for trends, _ in lined for trend in trends.values()], chance / 2)
    out = []
    for each, each_steps, (trends, spread) in zip(every, steps, lined, strict=True):
        change = each.group.change
        own = frozenset(p for p, t in trends.items() if p in clear and abs(change(t.slope * t.span)) >= floor)
        since = _since(each.own, each_steps, rho, {p: trends[p].slope > 0 for p in own}, chance / 2 / count)
        out.append(Judged(each.group, each.common, each.own, each_steps, trends, rho, spread, own, since, each.alone))
    return out


def _steps(each: _Prepared, rho: float, chance: float, floor: float) -> dict[Place, list[Step]]:
    """Steps of a kind's arms; weeks of one arm are not calmer than those of half the others."""
    scatters = [found.scatter for course in each.own.values() if (found := line(course, rho)) is not None]
    usual = 0.0 if each.alone or not scatters else float(np.median(scatters))
    return {
        place: [s for s in steps_in(course, rho, chance, usual) if abs(each.group.change(s.size)) >= floor]
        for place, course in each.own.items()
    }


def _trends(
    own: Mapping[Place, Course], steps: Mapping[Place, Sequence[Step]], rho: float
) -> tuple[dict[Place, Trend], float]:
    """Lines of a kind's arms against each other, and how far slopes of sound arms are apart."""
    lines = {place: found for place, course in own.items() if (found := line(course, rho, steps[place])) is not None}
    middle = {
        joint: float(np.median([each.slope for place, each in lines.items() if place.joint == joint]))
        for joint in {place.joint for place in lines}
    }
    alone = len({place.cell for place in lines}) < FEWEST
    beyond = {place: each.slope - (0.0 if alone else middle[place.joint]) for place, each in lines.items()}
    # Errors of lines of one length are alike in all arms; a longer line is more certain.
    length = {place: float(np.sum(_about(own[place].weeks, each) ** 2)) for place, each in lines.items()}
    squares = np.array([each.error**2 * length[place] for place, each in lines.items()])
    squares, free = moderated(squares, np.array([each.free for each in lines.values()]))
    errors = dict(zip(lines, np.sqrt(squares / np.array(list(length.values()))).tolist(), strict=True))
    spread = 0.0 if alone else spread_of(list(beyond.values()), list(errors.values()))
    out = {}
    for (place, each), own_free in zip(lines.items(), free.tolist(), strict=True):
        error, free_of = joint_freedom(errors[place], own_free, spread, len(lines))
        chance = 2 * float(student.sf(abs(beyond[place]) / error, free_of))
        out[place] = Trend(place, each, beyond[place], error, free_of, chance)
    return out, spread


def _about(weeks: NDArray[np.intp], each: Line) -> Float:
    inside = weeks[weeks >= each.first].astype(np.float64)
    return np.asarray(inside - inside.mean())


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
        trends, _ = _trends(known, before, rho)
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


def stepped(each: Judged) -> Iterator[tuple[Place, Step]]:
    """Iterate over all steps of a quantity."""
    for place, steps in sorted(each.steps.items()):
        for step in steps:
            yield place, step
