"""Leave-one-out: fits of a problem without one fold of its blocks, and their error on that fold.

The products of the rows are stored per fold, so that a set of terms is judged without another pass over the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from cellwatt.arrays import Bool, Float
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.robot.blocks import Block, Design, places
from cellwatt_plugins.robot.regression import Prior

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
        if "products" not in problem.of_design:
            problem.of_design["products"] = _Products(problem.design, *folds_of(problem))
        self.products: _Products = problem.of_design["products"]

    @property
    def fold(self) -> NDArray[np.intp]:
        """Number of the fold of each row, (N,)."""
        return self.products.fold

    def errors(self, terms: Sequence[Term]) -> Float:
        """Squared error (K, C) of each fold, in units of its variance, in the fit without that fold."""
        return self._fitted([self.problem.block(term) for term in terms])[1]

    def coefficients(self, terms: Sequence[Term]) -> Float:
        """Coefficients (K, P) of the fits without one fold each: the design's, then those of the terms."""
        return self._fitted([self.problem.block(term) for term in terms])[0]

    def residual(self, terms: Sequence[Term]) -> Float:
        """Residual (N, C) of each row in the fit without its fold."""
        design, blocks = self.problem.design, [self.problem.block(term) for term in terms]
        found = self._fitted(blocks)[0]
        out = np.empty_like(design.target)
        slices = places(blocks, design.size)
        for c, fixed in enumerate(design.channels):
            parts = [(block.of(c), place) for block, place in zip(blocks, slices, strict=True)]
            for rows, own in zip(self.products.rows, found, strict=True):
                fitted = fixed.columns[rows] @ own[fixed.places] / design.root[rows, c]
                fitted += sum(columns[rows] @ own[place] for columns, place in parts if columns is not None)
                out[rows, c] = design.target[rows, c] - fitted
        return out

    def _fitted(self, blocks: Sequence[Block]) -> tuple[Float, Float]:
        """Coefficients (K, P) of the fits without one fold each, and their squared errors (K, C) there; cached."""
        key, cache = (self.problem.nuisance, tuple(blocks), self.factor.tobytes()), self.products.fitted
        if key not in cache:
            if len(cache) > CACHED:
                cache.clear()
            cache[key] = self._fit(blocks)
        return cache[key]

    def _fit(self, blocks: Sequence[Block]) -> tuple[Float, Float]:
        design, products = self.problem.design, self.products
        slices = places(blocks, design.size)
        size = slices[-1].stop if slices else design.size
        count, channels = len(products.rows), len(design.channels)
        information, right = np.zeros((count, size, size)), np.zeros((count, size))
        equations = []
        for c in range(channels):
            indices, gram, pull = products.channel(c, blocks, slices)
            information[:, indices[:, None], indices] += gram / self.factor[c]
            right[:, indices] += pull / self.factor[c]
            equations.append((indices, gram, pull))
        prior = Prior.joined(*(block.prior for block in (*design.blocks, *blocks)))
        whole, pulled = information.sum(axis=0) + prior.precision, right.sum(axis=0) + prior.precision @ prior.mean
        found = np.stack([_solved(whole - information[k], pulled - right[k]) for k in range(count)])
        errors = np.empty((count, channels))
        for c, (indices, gram, pull) in enumerate(equations):
            own = found[:, indices]
            crossed = np.einsum("ki,kij,kj->k", own, gram, own)
            errors[:, c] = products.square[c] - 2 * np.sum(own * pull, axis=1) + crossed
        return found, np.maximum(errors, 0.0)


def _solved(information: Float, right: Float) -> Float:
    scale = 1 / np.sqrt(np.diag(information))
    factor = cho_factor(information * np.outer(scale, scale), lower=True, check_finite=False)
    return np.asarray(scale * cho_solve(factor, scale * right, check_finite=False))


class _Products:
    """Products of a design's rows in each of K folds; each pair of blocks is multiplied once, as long as both exist."""

    def __init__(self, design: Design, fold: NDArray[np.intp], count: int) -> None:
        self.design, self.fold = design, fold
        self.rows = [np.flatnonzero(fold == k) for k in range(count)]
        self._target = design.target * design.root
        self.square = [np.array([np.sum(column[rows] ** 2) for rows in self.rows]) for column in self._target.T]
        self._fixed = [Block(channel.columns, c, Prior.joined()) for c, channel in enumerate(design.channels)]
        """All columns of the design at each channel, weighted."""
        self.fitted: dict[tuple[object, ...], tuple[Float, Float]] = {}
        self._pulls = WeakKeyDictionary[Block, dict[int, Float]]()
        self._pairs = WeakKeyDictionary[Block, WeakKeyDictionary[Block, dict[int, Float]]]()

    def channel(
        self, c: int, blocks: Sequence[Block], slices: Sequence[slice]
    ) -> tuple[NDArray[np.intp], Float, Float]:
        """Coefficient indices (p,), gram (K, p, p) and right side (K, p) of a channel with further blocks."""
        acting = [self._fixed[c], *(b for b in blocks if b.channel in (None, c))]
        among = [np.arange(s.start, s.stop) for b, s in zip(blocks, slices, strict=True) if b.channel in (None, c)]
        indices = np.concatenate([self.design.channels[c].places, *among])
        gram = np.zeros((len(self.rows), len(indices), len(indices)))
        pull = np.zeros((len(self.rows), len(indices)))
        before: list[tuple[Block, slice]] = []
        for block, at in zip(acting, places(acting, 0), strict=True):
            before.append((block, at))
            pull[:, at] = self._pull(block, c)
            for other, beside in before:
                cross = self._pair(other, block, c)
                gram[:, at, beside], gram[:, beside, at] = cross.transpose(0, 2, 1), cross
        return indices, gram, pull

    def _pull(self, block: Block, c: int) -> Float:
        """Products (K, m) of a block at a channel with the target."""
        known = self._pulls.setdefault(block, {})
        if c not in known:
            columns = self._weighed(block, c)
            known[c] = np.stack([columns[rows].T @ self._target[rows, c] for rows in self.rows])
        return known[c]

    def _pair(self, one: Block, other: Block, c: int) -> Float:
        """Products (K, m, k) of two blocks at a channel."""
        known = self._pairs.setdefault(one, WeakKeyDictionary()).setdefault(other, {})
        if c not in known:
            a, b = self._weighed(one, c), self._weighed(other, c)
            known[c] = np.stack([a[rows].T @ b[rows] for rows in self.rows])
        return known[c]

    def _weighed(self, block: Block, c: int) -> Float:
        columns = block.of(c)
        assert columns is not None
        return columns if block is self._fixed[c] else columns * self.design.root[:, c : c + 1]


def folds_of(problem: Problem) -> tuple[NDArray[np.intp], int]:
    """Fold number of each fitted row (N,), and the number of folds; the blocks of all motions are dealt out in turn.

    Runs that repeat a motion share its folds: a motion that was fitted in one run is not unseen in another. If a motion
    is too short for that, each run is split by itself.
    """
    block = _blocks(problem, _motions([s.q for s in problem.states]))
    if max(int(part.max()) for part in block) < FEWEST - 1:
        block = _blocks(problem, range(len(problem.states)))
    count = min(FOLDS, 1 + max(int(part.max()) for part in block))
    return np.concatenate(block) % count, count


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
