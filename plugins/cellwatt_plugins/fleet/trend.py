"""Fits lines and steps to weekly courses, with errors from the scatter of the weeks.

Weeks differ by more than the errors of their recordings: the difference is a process with standard deviation τ and a
correlation ρ between successive weeks. τ is estimated per course (restricted maximum likelihood), ρ for all together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import stdtr

from cellwatt.arrays import Float
from cellwatt_plugins.fleet.adjusted import Course

MOST: Final = 2
"""Most steps reported per course."""
FEWEST: Final = 6
"""Fewest weeks of a line."""
EITHER_SIDE: Final = 3
"""Fewest weeks before and after a step."""
FAR_BETTER: Final = 6.0
"""Log likelihood ratio above which a step is reported in place of a line."""
PERSISTENCES: Final = (0.0, 0.2, 0.4, 0.6, 0.8)
CAREFUL: Final = 0.1
"""Added to the most likely correlation, as a correlation that is too low makes errors too small."""
LONGEST: Final = 0.9
"""Largest correlation: at 1, no number of weeks would distinguish a line from random variation."""
MOST_COURSES: Final = 120
"""Most courses used to estimate the correlation."""
_SCATTERS: Final = np.concatenate([[1e-3], np.geomspace(0.05, 3.0, 22)])
"""Values tried for τ, as shares of the scatter about the line."""


@dataclass(frozen=True)
class Line:
    """A line through a course, or through its weeks after the last step, from week ``first`` to ``last``.

    ``slope`` per week and its ``error`` with ``free`` degrees of freedom; ``scatter`` is τ.
    """

    slope: float
    error: float
    free: float
    first: int
    last: int
    scatter: float


@dataclass(frozen=True)
class Step:
    """A change between ``week`` and the week before.

    ``chance`` is the probability of an equally clear step anywhere in a course without steps.
    """

    week: int
    size: float
    error: float
    chance: float


def persistence(courses: Sequence[Course]) -> float:
    """Return the correlation between weeks of all courses about their lines, estimated on the high side."""
    long = [course for course in courses if len(course.weeks) >= FEWEST + 2]
    if not long:
        return LONGEST
    long = long[:: -(-len(long) // MOST_COURSES)]

    def likelihood(rho: float) -> float:
        return sum(_likely(course, _straight(course), rho)[0] for course in long)

    best = max(PERSISTENCES, key=likelihood)
    near = [best, *(rho for rho in (best - 0.1, best + 0.1) if rho > 0)]
    return min(max(near, key=likelihood) + CAREFUL, LONGEST)


def line(course: Course, rho: float, steps: Sequence[Step] = ()) -> Line | None:
    """Return the line through the weeks after the last of ``steps``; None if they are too few.

    The scatter is estimated from all weeks.
    """
    begins = [step.week for step in steps]
    part = np.searchsorted(np.sort(begins), course.weeks, side="right")
    last = course.weeks[part == part[-1]]
    if len(last) < FEWEST:
        return None
    time = _time(course)
    columns = []
    for each in np.unique(part):
        inside = (part == each).astype(np.float64)
        columns += [inside] if (part == each).sum() < EITHER_SIDE else [inside, inside * time]
    matrix = np.column_stack(columns)
    free = len(course.weeks) - matrix.shape[1]
    if free < 3:
        return None
    _, scatter, found, covariance = _likely(course, matrix, rho)
    error = float(np.sqrt(covariance[-1, -1]))
    return Line(found[-1], error, _remembered(free, rho), int(last[0]), int(last[-1]), scatter)


def steps_in(course: Course, rho: float, chance: float, scatter: float = 0.0) -> list[Step]:
    """Return the steps of a course in order, each with a probability below ``chance``.

    ``scatter`` is the smallest τ: the fit of the best step makes the scatter of a course too small by chance.
    """
    found: list[Step] = []
    while len(found) < MOST and (step := _step(course, rho, found, scatter)) is not None and step.chance < chance:
        found = sorted([*found, step], key=lambda each: each.week)
    return [_sized(course, rho, step, found) for step in found]


def rather_a_step(course: Course, rho: float, chance: float) -> Step | None:
    """Return the step that describes a course far better than a line; None if there is no such step.

    ``chance`` is that of the line.
    """
    weeks = course.weeks
    places = weeks[EITHER_SIDE : len(weeks) - EITHER_SIDE + 1]
    if not len(places):
        return None
    ones = np.ones(len(weeks))
    misfits = [_misfit(np.column_stack([ones, weeks >= week]), course.values) for week in places]
    best = int(np.argmin(misfits))
    if len(weeks) / 2 * np.log(_misfit(_straight(course), course.values) / misfits[best]) < FAR_BETTER:
        return None
    _, _, found, covariance = _likely(course, np.column_stack([ones, weeks >= places[best]]), rho)
    return Step(int(places[best]), float(found[1]), float(np.sqrt(covariance[1, 1])), chance)


def _sized(course: Course, rho: float, step: Step, every: Sequence[Step]) -> Step:
    """The step between a line before and a line after it, if both are long enough for slopes of their own."""
    others = [each.week for each in every if each is not step]
    before = [week for week in others if week < step.week]
    after = [week for week in others if week > step.week]
    near = (course.weeks >= max(before, default=0)) & (course.weeks < min(after, default=course.weeks[-1] + 1))
    part = course.part(near)
    late = (part.weeks >= step.week).astype(np.float64)
    if min(late.sum(), (1 - late).sum()) < FEWEST:
        return step
    time = part.weeks - step.week + 0.5
    matrix = np.column_stack([np.ones_like(time), time, late, late * time])
    _, _, found, covariance = _likely(part, matrix, rho)
    return replace(step, size=float(found[2]), error=float(np.sqrt(covariance[2, 2])))


def _step(course: Course, rho: float, known: Sequence[Step], scatter: float) -> Step | None:
    """The clearest step in addition to the known ones."""
    time = _time(course)
    weeks = course.weeks
    base = np.column_stack([np.ones_like(time), time, *((weeks >= step.week).astype(float) for step in known)])
    places = [
        int(week)
        for week in weeks[EITHER_SIDE : len(weeks) - EITHER_SIDE + 1]
        if all(np.sum((weeks >= min(week, k.week)) & (weeks < max(week, k.week))) >= EITHER_SIDE for k in known)
    ]
    if not places or len(weeks) - base.shape[1] < 4:
        return None
    misfits = {week: _misfit(np.column_stack([base, weeks >= week]), course.values) for week in places}
    best = min(misfits, key=lambda week: misfits[week])
    if misfits[best] >= _misfit(np.column_stack([base, time**2]), course.values):
        return None
    matrix = np.column_stack([base, weeks >= best])
    _, _, found, covariance = _likely(course, matrix, rho, scatter)
    error = float(np.sqrt(covariance[-1, -1]))
    free = _remembered(len(weeks) - matrix.shape[1], rho)
    chance = min(1.0, 2 * float(stdtr(free, -abs(found[-1]) / error)) * len(places))
    return Step(best, float(found[-1]), error, chance)


def _remembered(free: float, rho: float) -> float:
    """Effective degrees of freedom of correlated weeks."""
    return free * (1 - rho**2) / (1 + rho**2)


def _misfit(matrix: Float, values: Float) -> float:
    found = np.linalg.lstsq(matrix, values, rcond=None)[0]
    return float(np.sum((values - matrix @ found) ** 2))


def _time(course: Course) -> Float:
    return np.asarray(course.weeks - course.weeks.mean(), np.float64)


def _straight(course: Course) -> Float:
    time = _time(course)
    return np.column_stack([np.ones_like(time), time])


def _likely(course: Course, matrix: Float, rho: float, least: float = 0.0) -> tuple[float, float, Float, Float]:
    """Restricted log likelihood at the most likely τ (``least`` or more), that τ, coefficients, their covariance."""
    count, free = matrix.shape[0], matrix.shape[0] - matrix.shape[1]
    size = max(np.sqrt(_misfit(matrix, course.values) / max(free, 1)), 1e-9)
    apart = np.abs(course.weeks[:, None] - course.weeks[None, :])
    shape = np.where(apart == 0, 1.0, rho**apart) if rho > 0 else np.eye(count)
    scatters = np.maximum(size * _SCATTERS, least)
    every = course.covariance[None] + scatters[:, None, None] ** 2 * shape[None]
    root = np.linalg.cholesky(every)
    right = np.broadcast_to(np.column_stack([matrix, course.values]), (len(root), count, matrix.shape[1] + 1))
    white = np.linalg.solve(root, right)
    columns, target = white[:, :, :-1], white[:, :, -1]
    gram = np.einsum("kni,knj->kij", columns, columns)
    pull = np.einsum("kni,kn->ki", columns, target)
    found = np.linalg.solve(gram, pull[:, :, None])[:, :, 0]
    misfit = np.einsum("kn,kn->k", target, target) - np.einsum("ki,ki->k", found, pull)
    volume = 2 * np.log(np.einsum("kii->ki", root)).sum(axis=1)
    likelihood = -0.5 * (volume + np.linalg.slogdet(gram)[1] + misfit)
    best = int(np.argmax(likelihood))
    return float(likelihood[best]), float(scatters[best]), found[best], np.linalg.inv(gram[best])
