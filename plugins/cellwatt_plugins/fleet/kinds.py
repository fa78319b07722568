"""Compares arms of one kind: finds their common course and the spread of healthy arms."""

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
"""Fewest arms of a kind for a common course."""
ROUNDS: Final = 6
MIDDLE: Final = 0.6745
"""Median absolute deviation of a normal distribution, in standard deviations."""
MOST_FREE: Final = 60.0
"""Most degrees of freedom that the other arms add."""
WORTH: Final = 0.37
"""Efficiency of the median deviation: its degrees of freedom as a share of the number of values."""


@dataclass(frozen=True)
class Common:
    """Common course of the arms of a kind: medians by week, with a mean of 0."""

    weeks: NDArray[np.intp]
    values: Float


def common_course(courses: Mapping[K, Course]) -> Common | None:
    """Return the common course of the arms, over weeks with data of enough arms; None if the arms are too few.

    Tukey's median polish: the median of each arm and the median of each week are subtracted in turn.
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
    """Return the course minus the common course, in the weeks of the common course."""
    shared = course.part(np.isin(course.weeks, common.weeks))
    return shared.less(common.values[np.searchsorted(common.weeks, shared.weeks)])


def spread_of(values: Sequence[float] | Float, errors: Sequence[float] | Float) -> float:
    """Return the standard deviation between healthy arms beyond the ``errors`` of their ``values``.

    It is estimated from the median deviation, which a few faulty arms hardly change.
    """
    value, square = np.abs(np.asarray(values, np.float64)), np.square(np.asarray(errors, np.float64))
    if len(value) < FEWEST or np.median(value / np.sqrt(square)) <= MIDDLE:
        return 0.0
    most = float(value.max()) / MIDDLE + 1e-300
    return float(brentq(lambda apart: np.median(value / np.sqrt(square + apart**2)) - MIDDLE, 0.0, most, xtol=1e-15))


def moderated(squares: Float, free: Float) -> tuple[Float, Float]:
    """Return variances (K,) shrunk towards those of the others, and their degrees of freedom.

    ``squares`` are estimates with ``free`` degrees of freedom each. Variances of healthy arms are similar; the amount
    of shrinkage follows from their spread (Smyth, Statistical Applications in Genetics and Molecular Biology 3, 2004,
    3).
    """
    if len(squares) < FEWEST:
        return squares, free
    log = np.log(squares) - digamma(free / 2) + np.log(free / 2)
    beyond = float(np.var(log, ddof=1) - np.mean(polygamma(1, free / 2)))
    if beyond <= 0:
        return np.full_like(squares, np.exp(log.mean())), free + MOST_FREE
    # Trigamma falls: a smaller value is that of more degrees of freedom than are added.
    beyond = max(beyond, float(polygamma(1, MOST_FREE / 2)))
    prior = 2 * float(brentq(lambda half: float(polygamma(1, half)) - beyond, 1e-3, 1e6))
    usual = float(np.exp(log.mean() + digamma(prior / 2) - np.log(prior / 2)))
    return (prior * usual + free * squares) / (prior + free), free + prior


def summed(parts: Sequence[tuple[Float, Float | float]]) -> tuple[Float, Float]:
    """Return the sum of independent variances (K,) and its degrees of freedom (Welch and Satterthwaite).

    ``parts`` are the variances with their degrees of freedom.
    """
    whole = np.sum([square for square, _ in parts], axis=0)
    return whole, np.asarray(whole**2 / np.sum([square**2 / free for square, free in parts], axis=0))
