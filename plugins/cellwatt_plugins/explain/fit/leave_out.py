"""Leave-one-out: fits of a problem without one fold of its blocks, and their error on that fold.

The products of the rows are stored per fold, so that a set of terms is judged without another pass over the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Bool, Float
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.robot.blocks import Block, Design, together
from cellwatt_plugins.robot.regression import Fit, Prior, Products

FOLDS, FEWEST = 10, 5
"""Largest number of folds, and smallest number of folds for motions that repeat."""
BLOCK, SHORTEST = 4.0, 1.0
"""Longest and shortest block, in s; the shortest is for short recordings."""
LITTLE = 0.003
"""Share of a channel's mean square error below which a fold's error is negligible."""
ALIKE, STILL = 0.1, 1e-3
"""Largest deviation between repeats of a motion: a share of the motion's standard deviation, plus rad."""
NOTHING = 1e-3
"""Squared error of a fold, in units of the noise, below which a channel counts as not measured."""
CACHED = 400
"""Largest number of stored fits."""


@dataclass(frozen=True)
class Held:
    """Change of the error on data left out by a change of the model."""

    share: float
    """Share of the mean square error that the change removes, summed over the chosen channels."""
    sure: float
    """Mean removed error per fold, in its standard errors."""
    rise: float
    """Largest relative rise of any channel's mean square error."""
    again: bool
    """True if the change also removes error without the fold in which it removes most."""
    most: float
    """Share of the mean square error removed at the chosen channel where it is largest."""


def compared(before: Float, after: Float, channels: Sequence[int] | None = None) -> Held:
    """Compare squared errors (K, C) of K folds: paired by fold, each channel in units of its own error before."""
    scale = np.mean(before, axis=0)
    # The error of a channel that was not measured can neither fall nor rise.
    scale = np.where(scale > NOTHING, scale, np.inf)
    chosen = slice(None) if channels is None else list(channels)
    saved = (before - after) / scale
    own = np.sum(saved[:, chosen], axis=1)
    # The ratio of a fold's errors shows an intermittent effect even if one fold outweighs all others.
    ratio = np.sum(np.log((before / scale + LITTLE) / (after / scale + LITTLE))[:, chosen], axis=1)
    again = bool(np.sum(own) - np.max(own) > 0)
    of_each = np.mean(saved, axis=0)
    sure, rise, most = max(_sure(own), _sure(ratio)), float(np.max(-of_each)), float(np.max(of_each[chosen]))
    return Held(float(np.mean(own)), sure, rise, again, most)


def _sure(values: Float) -> float:
    """Mean of values, in its standard errors."""
    if len(values) < 2:
        return 0.0
    spread = float(np.std(values, ddof=1) / np.sqrt(len(values)))
    return float(np.mean(values)) / max(spread, 1e-12)


class LeaveOut:
    """Fits of a problem that leave out one fold each; ``factor`` (C,) is the correlation factor of the residual."""

    def __init__(self, problem: Problem, factor: Float) -> None:
        self.problem, self.factor = problem, factor
        if "folds" not in problem.of_design:
            problem.of_design["folds"] = Folds(problem.design, folds_of(problem))
        self.folds: Folds = problem.of_design["folds"]

    @property
    def fold(self) -> NDArray[np.intp]:
        """Number of the fold of each row, (N,)."""
        return self.folds.fold

    def errors(self, terms: Sequence[Term]) -> Float:
        """Squared error (K, C) of each fold, in units of its variance, in the fit without that fold."""
        return self._fitted([self.problem.block(term) for term in terms])[1]

    def coefficients(self, terms: Sequence[Term]) -> Float:
        """Coefficients (K, P) of the fits without one fold each: the design's, then those of the terms."""
        return self._fitted([self.problem.block(term) for term in terms])[0]

    def residual(self, terms: Sequence[Term]) -> Float:
        """Residual (N, C) of each row in the fit without its fold."""
        blocks, folds = [self.problem.block(term) for term in terms], self.folds
        out = np.empty_like(self.problem.design.target)
        parts = zip(folds.rows, folds.designs, folds.blocks(blocks), self._fitted(blocks)[0], strict=True)
        for rows, design, own, coefficients in parts:
            out[rows] = design.target - design.fitted(own, coefficients)
        return out

    def _fitted(self, blocks: Sequence[Block]) -> tuple[Float, Float]:
        """Coefficients (K, P) of the fits without one fold each, and their squared errors (K, C) there; cached."""
        key, cache = (self.problem.nuisance, tuple(blocks), self.factor.tobytes()), self.folds.fitted
        if key not in cache:
            if len(cache) > CACHED:
                cache.clear()
            prior = Prior.joined(*(block.prior for block in (*self.problem.design.blocks, *blocks)))
            cache[key] = self.folds.fits(blocks, prior, self.factor)
        return cache[key]


class Folds:
    """One design per fold of the rows of a ``design``, whose folds have the numbers ``fold`` (N,)."""

    def __init__(self, design: Design, fold: NDArray[np.intp]) -> None:
        self.fold = fold
        self.rows = [np.flatnonzero(fold == k) for k in range(int(fold.max()) + 1)]
        self.designs = [design.of_rows(rows) for rows in self.rows]
        self.fitted: dict[tuple[object, ...], tuple[Float, Float]] = {}
        self._parts = WeakKeyDictionary[Block, list[Block]]()
        self._equations: tuple[tuple[Block, ...] | None, list[list[tuple[NDArray[np.intp], Products]]]] = None, []

    def blocks(self, blocks: Sequence[Block]) -> list[list[Block]]:
        """The rows of further blocks in each of the K folds, stored as long as the blocks exist."""
        for block in blocks:
            if block not in self._parts:
                self._parts[block] = [replace(block, columns=block.columns[rows]) for rows in self.rows]
        return [[self._parts[block][k] for block in blocks] for k in range(len(self.rows))]

    def fits(self, blocks: Sequence[Block], prior: Prior, factor: Float) -> tuple[Float, Float]:
        """Coefficients (K, P) of the fits without one fold each, and their squared errors (K, C) there.

        ``prior`` is that of all coefficients, the design's and those of further blocks.
        """
        # Of the same blocks, other priors are tried one after the other.
        if self._equations[0] != tuple(blocks):
            parts = zip(self.designs, self.blocks(blocks), strict=True)
            self._equations = tuple(blocks), [design.equations(own) for design, own in parts]
        equations = self._equations[1]
        products = [together(own, factor, len(prior.mean)) for own in equations]
        whole = sum(products[1:], start=products[0])
        found = [Fit(whole - own, prior).coefficients for own in products]
        errors = [[own.misfit(x[at]) for at, own in each] for each, x in zip(equations, found, strict=True)]
        return np.stack(found), np.maximum(errors, 0.0)


def folds_of(problem: Problem) -> NDArray[np.intp]:
    """Fold number of each fitted row (N,); the blocks of all motions are dealt out in turn.

    Runs that repeat a motion share its folds: a motion that was fitted in one run is not unseen in another. If a motion
    is too short for that, each run is split by itself.
    """
    block = _blocks(problem, _motions([s.q for s in problem.states]))
    if max(int(part.max()) for part in block) < FEWEST - 1:
        block = _blocks(problem, range(len(problem.states)))
    count = min(FOLDS, 1 + max(int(part.max()) for part in block))
    return np.concatenate(block) % count


def _blocks(problem: Problem, motions: Sequence[int]) -> list[NDArray[np.intp]]:
    """Block number of each fitted row of each run; ``motions`` holds, for each run, the run whose blocks it shares."""
    seconds = [float(s.time[-1] - s.time[0]) for s in problem.states]
    block = float(np.clip(sum(seconds[i] for i in set(motions)) / FOLDS, SHORTEST, BLOCK))
    counts = [max(1, round(seconds[i] / block)) if i == motion else 0 for i, motion in enumerate(motions)]
    first = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
    return [
        first[i] + np.arange(len(part)) * counts[i] // max(len(part), 1)
        for i, part in zip(motions, problem.target, strict=True)
    ]


def _motions(courses: Sequence[Float]) -> list[int]:
    """For each run, the index of the first run with the same motion; ``courses`` (N, n) rad are the runs' positions."""
    out = list[int]()
    for course in courses:
        same = (i for i, other in enumerate(courses[: len(out)]) if _alike(course, other))
        out.append(next(same, len(out)))
    return out


def _alike(one: Float, other: Float) -> bool:
    """True if two motions stay within ``ALIKE`` and ``STILL`` of each other at all times."""
    if abs(len(one) - len(other)) > ALIKE * len(one):
        return False
    common = min(len(one), len(other))
    return bool(np.all(np.std(one[:common] - other[:common], axis=0) < ALIKE * np.std(one, axis=0) + STILL))


def rms(residual: Float, counted: Bool | Literal[True] = True) -> Float:
    """Root mean square (C,) of a residual (N, C), of the samples ``counted`` (N, C)."""
    count = np.sum(np.broadcast_to(counted, residual.shape), axis=0)
    return np.asarray(np.sqrt(np.sum(np.square(residual), axis=0, where=counted) / np.maximum(count, 1)))
