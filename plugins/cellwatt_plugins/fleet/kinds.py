"""Arms of one kind against each other: what all do together, and how far sound ones are apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma

from cellwatt.arrays import Float
from cellwatt_plugins.fleet.adjusted import Course

K = TypeVar("K")

FEWEST: Final = 5
"""Arms of a kind that tell what is common, at least."""
ROUNDS: Final = 6
MIDDLE: Final = 0.6745
"""Half of all values of a normal distribution are within so many standard deviations."""
MOST_FREE: Final = 60.0
"""Degrees of freedom that the other arms add at most."""
WORTH: Final = 0.37
"""Share of the values that a median deviation is worth, for its degrees of freedom."""


@dataclass(frozen=True)
class Common:
    """Medians by week over the arms of a kind, about 0."""

    weeks: NDArray[np.intp]
    values: Float


def common_course(courses: Mapping[K, Course]) -> Common | None:
    """Return what the arms do together, from weeks in which enough of them have data; None where too few arms are.

    Each week's median of what is left when each arm's own median is taken out, in turns (Tukey's median polish).
    """
    if len(courses) < FEWEST:
        return None
    weeks = np.unique(np.concatenate([course.weeks for course in courses.values()]))
    table = np.full((len(courses), len(weeks)), np.nan)
    for row, course in zip(table, courses.values(), strict=True):
        row[np.searchsorted(weeks, course.weeks)] = course.values
    enough = np.isfinite(table).sum(axis=0) >= FEWEST
    table, weeks = table[:, enough], weeks[enough]
    table = table[np.isfinite(table).any(axis=1)]
    if not table.size:
        return None
    common = np.zeros(len(weeks))
    for _ in range(ROUNDS):
        table = table - np.nanmedian(table, axis=1, keepdims=True)
        middle = np.nanmedian(table, axis=0)
        common, table = common + middle, table - middle
    return Common(weeks, common - common.mean())


def less_common(course: Course, common: Common) -> Course:
    """Return the course without what is common, in the weeks in which that is known."""
    kept = course.part(np.isin(course.weeks, common.weeks))
    return kept.less(common.values[np.searchsorted(common.weeks, kept.weeks)])


def spread_of(values: Sequence[float] | Float, errors: Sequence[float] | Float) -> float:
    """Return the standard deviation by which sound arms differ beyond the ``errors`` of their ``values``.

    The median deviation tells it, which a few arms that are not sound hardly change.
    """
    value, square = np.abs(np.asarray(values, np.float64)), np.square(np.asarray(errors, np.float64))
    if len(value) < FEWEST or np.median(value / np.sqrt(square)) <= MIDDLE:
        return 0.0
    most = float(value.max()) / MIDDLE + 1e-300
    return float(brentq(lambda apart: np.median(value / np.sqrt(square + apart**2)) - MIDDLE, 0.0, most, xtol=1e-15))


def moderated(squares: Float, free: Float) -> tuple[Float, Float]:
    """Return variances (K,) drawn towards those of the others, and their degrees of freedom.

    ``squares`` are estimates with ``free`` degrees of freedom each. Variances of sound arms are much alike: how much,
    their own spread tells (Smyth, Statistical Applications in Genetics and Molecular Biology 3, 2004, 3).
    """
    if len(squares) < FEWEST:
        return squares, free
    log = np.log(squares) - digamma(free / 2) + np.log(free / 2)
    beyond = float(np.var(log, ddof=1) - np.mean(polygamma(1, free / 2)))
    if beyond <= 0:
        return np.full_like(squares, np.exp(log.mean())), free + MOST_FREE
    prior = min(2 * _inverse_trigamma(beyond), MOST_FREE)
    usual = float(np.exp(log.mean() + digamma(prior / 2) - np.log(prior / 2)))
    return (prior * usual + free * squares) / (prior + free), free + prior


def _inverse_trigamma(value: float) -> float:
    return float(brentq(lambda x: float(polygamma(1, x)) - value, 1e-3, 1e6))


def summed(parts: Sequence[tuple[Float, Float | float]]) -> tuple[Float, Float]:
    """Return the sum of independent variances (K,), and its degrees of freedom (Welch and Satterthwaite).

    ``parts`` are the variances with their degrees of freedom.
    """
    whole = np.sum([square for square, _ in parts], axis=0)
    return whole, np.asarray(whole**2 / np.sum([square**2 / free for square, free in parts], axis=0))
