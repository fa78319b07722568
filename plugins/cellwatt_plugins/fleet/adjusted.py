"""Weekly means of the repetitions' values, with the effects of programs and temperature removed as in a two-way table.

Recordings of one week share a level, repetitions of one program an effect. Errors come from the scatter of recordings
within a week, since samples and repetitions within a recording are not independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

Index = NDArray[np.intp]

FEWEST: Final = 3.0
"""Fewest degrees of freedom with which the scatter of recordings is estimated."""
LEAST: Final = 1e-4
"""Smallest scatter of recordings."""
SURE: Final = 3.0
"""Smallest slope over temperature that is removed, in multiples of its error."""


@dataclass(frozen=True)
class Course:
    """A quantity by week: W weeks, rising, with the ``covariance`` (W, W) of the errors of ``values``."""

    weeks: Index
    values: Float
    covariance: Float

    def part(self, chosen: NDArray[np.bool_] | Index) -> Course:
        """Return the course in the ``chosen`` weeks."""
        return Course(self.weeks[chosen], self.values[chosen], self.covariance[chosen][:, chosen])

    def about_mean(self) -> Course:
        """Return the course minus its mean, without the error that all weeks share."""
        centred = np.eye(len(self.weeks)) - 1 / len(self.weeks)
        return Course(self.weeks, centred @ self.values, centred @ self.covariance @ centred)

    def less(self, what: Float) -> Course:
        """Return the course minus ``what`` (W,)."""
        return Course(self.weeks, self.values - what, self.covariance)


@dataclass(frozen=True)
class Observations:
    """``values`` (K,) of one quantity from K repetitions of one cell, with temperature ``warmth`` (K,) °C.

    ``recording`` numbers the recordings uniquely.
    """

    values: Float
    week: Index
    recording: Index
    program: Index
    warmth: Float | None = None

    def by_recording(self) -> Observations:
        """Return the means over repetitions of one program in one recording, without NaN."""
        known = np.isfinite(self.values)
        keys = np.stack([self.recording[known], self.program[known]], axis=1)
        _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        group = group.ravel()
        count = np.bincount(group, minlength=len(first))

        def mean(values: Float) -> Float:
            return np.asarray(np.bincount(group, values[known], len(first)) / count)

        warmth = None if self.warmth is None else mean(self.warmth)
        rows = np.flatnonzero(known)[first]
        return Observations(mean(self.values), self.week[rows], self.recording[rows], self.program[rows], warmth)


@dataclass(frozen=True)
class Warmth:
    """Slope of a quantity over temperature, per °C, and its error; infinite if temperature did not vary."""

    slope: float
    error: float


UNTOUCHED: Final = Warmth(0.0, 0.0)
"""Temperature has no effect that is removed."""


def apart(observed: Observations, programs: float) -> float:
    """Return the scatter of recordings (from ``by_recording``) of one week and program; NaN if there are too few."""
    return _solved(observed, programs, float("nan"), with_warmth=observed.warmth is not None)[2] or float("nan")


def warmth_of(observed: Observations, programs: float) -> Warmth:
    """Return the slope over temperature within weeks, which wear over weeks does not affect."""
    if observed.warmth is None:
        return Warmth(0.0, float("inf"))
    found, inverse, noise = _solved(observed, programs, float("nan"), with_warmth=True)
    error = noise * float(np.sqrt(inverse[-1, -1])) if noise > 0 else float("inf")
    return Warmth(float(found[-1]), error if np.isfinite(error) else float("inf"))


def shrunk(slopes: Sequence[Warmth]) -> list[Warmth]:
    """Return each arm's slope shrunk towards the mean of its kind; 0 for all if even that mean is not significant."""
    nothing = [UNTOUCHED] * len(slopes)
    known = [each for each in slopes if np.isfinite(each.error) and each.error > 0]
    if not known:
        return nothing
    value = np.array([each.slope for each in known])
    square = np.square([each.error for each in known])
    mean = float(np.sum(value / square) / np.sum(1 / square))
    excess = float(np.sum((value - mean) ** 2 / square)) - (len(known) - 1)
    scale = float(np.sum(1 / square) - np.sum(1 / square**2) / np.sum(1 / square)) if len(known) > 1 else 0.0
    between = max(excess / scale, 0.0) if scale > 0 else 0.0  # DerSimonian and Laird
    weight = 1 / (square + between)
    mean, error = float(np.sum(weight * value) / weight.sum()), float(1 / np.sqrt(weight.sum()))
    if abs(mean) < SURE * error:
        return nothing
    own = [between / (between + each.error**2) if np.isfinite(each.error) else 0.0 for each in slopes]
    return [
        Warmth(mean + w * (each.slope - mean) if w > 0 else mean, float(np.sqrt(between * (1 - w))))
        for w, each in zip(own, slopes, strict=True)
    ]


def course_of(
    observed: Observations, programs: float, usual: float, slope: Warmth = UNTOUCHED, warm: float = 0.0
) -> Course:
    """Return the weekly values of one cell, from the values of ``by_recording``.

    ``programs`` is the standard deviation between programs, ``usual`` the scatter of recordings if these are too few to
    estimate it, ``slope`` the change per °C above ``warm``; its error is common to all warm weeks.
    """
    heat = np.zeros(len(observed.values)) if observed.warmth is None else observed.warmth - warm
    corrected = Observations(observed.values - slope.slope * heat, observed.week, observed.recording, observed.program)
    weeks, week = np.unique(observed.week, return_inverse=True)
    found, inverse, noise = _solved(corrected, programs, usual, with_warmth=False)
    count = len(weeks)
    by_heat = slope.error * np.bincount(week, heat) / np.bincount(week)
    return Course(weeks, found[:count], noise**2 * inverse[:count, :count] + np.outer(by_heat, by_heat))


def _solved(observed: Observations, programs: float, usual: float, *, with_warmth: bool) -> tuple[Float, Float, float]:
    """Return coefficients (weeks, programs, warmth), their covariance at a noise of 1, and the noise."""
    weeks, week = np.unique(observed.week, return_inverse=True)
    kinds, kind = np.unique(observed.program, return_inverse=True)
    rows = len(observed.values)
    matrix = np.zeros((rows, len(weeks) + len(kinds) + with_warmth))
    matrix[np.arange(rows), week] = 1.0
    matrix[np.arange(rows), len(weeks) + kind] = 1.0
    if with_warmth and observed.warmth is not None:
        matrix[:, -1] = observed.warmth - observed.warmth.mean()
    noise = usual if np.isfinite(usual) else 0.05
    tied = np.zeros(matrix.shape[1])
    tied[len(weeks) : len(weeks) + len(kinds)] = 1.0
    gram, pull = matrix.T @ matrix, matrix.T @ observed.values
    for _ in range(4):
        ridge = np.diag(tied * (noise / programs) ** 2 + (1e-9 if with_warmth else 0.0))
        inverse = np.linalg.inv(gram + ridge)
        found = inverse @ pull
        free = rows - float(np.trace(gram @ inverse))
        if free < FEWEST:
            noise = usual
            break
        noise = max(float(np.sqrt(np.sum((observed.values - matrix @ found) ** 2) / free)), LEAST)
    return found, np.asarray(inverse), noise if np.isfinite(noise) else 0.0
