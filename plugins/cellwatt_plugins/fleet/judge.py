"""Decides which trends and steps are significant, with one probability of a false finding for the whole fleet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.special import stdtrit

from cellwatt_plugins.fleet.adjusted import Course
from cellwatt_plugins.fleet.courses import CellJoint, Courses
from cellwatt_plugins.fleet.kinds import FEWEST, Common, common_course, less_common
from cellwatt_plugins.fleet.slopes import Trend, trends_of
from cellwatt_plugins.fleet.trend import Step, line, persistence, rather_a_step, steps_in

SHARES: Final = {"friction": 0.6, "energy": 0.4}
"""Share of each quantity in the probability of a false finding; steps use half of it, trends the other half."""
LONG_ENOUGH: Final = 6
"""Fewest weeks of a course."""


@dataclass(frozen=True)
class Judged:
    """Courses of a quantity of one kind, with the ``common`` course (by joint) removed, and their significant changes.

    ``own`` are the courses that are long enough, ``sure`` the joints with a significant trend; ``steps`` are the
    significant steps, including trends better described as a step. ``smallest`` is the slope per week that would be
    found in half the joints, or NaN.
    """

    courses: Courses
    common: Mapping[int, Common | None]
    own: Mapping[CellJoint, Course]
    trends: Mapping[CellJoint, Trend] = field(default_factory=dict)
    sure: frozenset[CellJoint] = frozenset()
    steps: Sequence[tuple[CellJoint, Step]] = ()
    smallest: float = float("nan")

    @classmethod
    def of(cls, courses: Courses) -> Judged:
        """Subtract the common courses, without judging."""
        common: dict[int, Common | None] = {}
        own: dict[CellJoint, Course] = {}
        for joint in sorted({place.joint for place in courses.by_place}):
            those = {place: course for place, course in courses.by_place.items() if place.joint == joint}
            common[joint] = shared = common_course(those)
            own |= {place: course if shared is None else less_common(course, shared) for place, course in those.items()}
        return cls(courses, common, {place: each for place, each in own.items() if len(each.weeks) >= LONG_ENOUGH})

    @property
    def alone(self) -> bool:
        """True if the kind has too few arms to find a common course."""
        return self.courses.cells < FEWEST

    def steps_by_place(self, rho: float, chance: float, least: float) -> dict[CellJoint, list[Step]]:
        """Steps of a kind's arms; the scatter assumed for one arm is at least the median of all arms."""
        scatters = [found.scatter for course in self.own.values() if (found := line(course, rho)) is not None]
        usual = float(np.median(scatters)) if scatters and not self.alone else 0.0
        return {
            place: [s for s in steps_in(course, rho, chance, usual) if abs(np.expm1(s.size)) >= least]
            for place, course in self.own.items()
        }


def judged(groups: Sequence[Courses], chance: float, least: float) -> list[Judged]:
    """Judge all courses of a fleet with a probability ``chance`` of one false finding in all; changes smaller than
    ``least`` are not reported."""
    out = []
    for quantity, share in SHARES.items():
        every = [Judged.of(group) for group in groups if group.quantity == quantity]
        out += _judged_together(every, share * chance, least)
    return out


def _judged_together(every: Sequence[Judged], chance: float, least: float) -> list[Judged]:
    """Judge one quantity of all kinds, with one correlation between weeks and one probability of a false finding."""
    rho = persistence([course for each in every for course in each.own.values()])
    level = chance / 2 / max(sum(len(each.own) for each in every), 1)
    steps = [each.steps_by_place(rho, level, least) for each in every]
    lined = [trends_of(each.own, own_steps, rho) for each, own_steps in zip(every, steps, strict=True)]
    clear = _holm([trend for trends in lined for trend in trends.values()], chance / 2)
    out = []
    for each, own_steps, trends in zip(every, steps, lined, strict=True):
        sure = {p for p, t in trends.items() if p in clear and abs(np.expm1(t.slope * t.span)) >= least}
        reported = [(place, step) for place, found in sorted(own_steps.items()) for step in found]
        for place in sorted(sure):
            step = None if own_steps[place] else rather_a_step(each.own[place], rho, trends[place].chance)
            if step is not None:
                sure.remove(place)
                reported.append((place, step))
        smallest = float(np.median([-float(stdtrit(t.free, level / 2)) * t.error for t in trends.values()] or [np.nan]))
        out.append(replace(each, trends=trends, sure=frozenset(sure), steps=reported, smallest=smallest))
    return out


def _holm(trends: Sequence[Trend], chance: float) -> set[CellJoint]:
    """Joints with significant trends by Holm's step-down procedure."""
    out: set[CellJoint] = set()
    for i, trend in enumerate(sorted(trends, key=lambda each: each.chance)):
        if trend.chance * (len(trends) - i) > chance:
            break
        out.add(trend.place)
    return out
