"""Cross-validation: the error on blocks of the given runs that are left out of the fit in turn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.folds import LEFT_OUT, Folds
from cellwatt_plugins.mismatch.fit.problem import Problem, Term
from cellwatt_plugins.robot.blocks import Block, Design, Regression

Float = NDArray[np.float64]

FOLDS = 4
BLOCK = 4.0
"""s of a block, about."""


class CrossValidation:
    """Fits of a problem in which a quarter of all blocks is left out, one fit for each quarter."""

    def __init__(self, problem: Problem, factor: Float) -> None:
        self.problem, self.factor = problem, factor
        self.number = blocks_of(problem)
        self.fold = self.number % FOLDS

    def residual(self, terms: Sequence[Term]) -> Float:
        """Residual (N, C) of each row in the fit that did not see it."""
        folds = self.problem.kept("folds", lambda: Folds(self.problem.design, self.fold, FOLDS))
        return folds.residual([self.problem.block(term) for term in terms], self.factor)

    def fits(self, terms: Sequence[Term]) -> Iterator[Regression]:
        """The fit without the rows of each fold in turn."""
        blocks: list[Block] = [self.problem.block(term) for term in terms]
        whole = self.problem.design
        for k in range(FOLDS):
            variance = np.where(self.fold[:, None] == k, LEFT_OUT, 1.0) / whole.root**2
            yield Regression(Design(whole.target, variance, whole.blocks), blocks, self.factor)

    def by_block(self, course: Float) -> Float:
        """Sums (B, C) over each block of what is given for each row, (N, C)."""
        out = np.zeros((int(self.number[-1]) + 1, course.shape[1]))
        for c in range(course.shape[1]):
            out[:, c] = np.bincount(self.number, course[:, c], len(out))
        return out


def confirmed_share(problem: Problem, term: Term, coefficients: Float, residual: Float) -> float:
    """Share of a simulated effect that runs left out confirm, 0 to 1, less its standard error.

    Its shape is chosen anew for each run among those tried, by the other runs; ``residual`` (N, C) is that with the
    term in the fit. 1 where there is one run alone.
    """
    joint = term.joint or 0
    left = problem.every_sample(residual)
    if len(left) < 2:
        return 1.0
    own = [_at(columns @ coefficients, joint) for columns in problem.columns(term)]
    course = [part[:, joint] + more for part, more in zip(left, own, strict=True)]
    shapes = [term.shape, *term.effect.shapes(problem.states, term.joint, left)]
    tried = [np.concatenate(term.effect.grid(s, term.joint, shapes), axis=1) for s in problem.states]
    pull = np.stack([columns.T @ part for columns, part in zip(tried, course, strict=True)])
    size = np.stack([np.sum(columns**2, axis=0) for columns in tried])
    met, made = np.zeros(len(left)), np.zeros(len(left))
    for run in range(len(left)):
        others = np.arange(len(left)) != run
        drop = np.maximum(pull[others].sum(0), 0.0) ** 2 / np.maximum(size[others].sum(0), 1e-12)
        best = int(np.argmax(drop))
        met[run], made[run] = pull[run, best], size[run, best]
    share, spread = _ratio(met, made)
    return float(np.clip((share - spread) / coefficients[0], 0.0, 1.0))


def _ratio(above: Float, below: Float) -> tuple[float, float]:
    """Ratio of two sums over the runs, and its standard error: jackknife (Efron 1982)."""
    count = len(above)
    without = (np.sum(above) - above) / np.maximum(np.sum(below) - below, 1e-12)
    spread = np.sqrt((count - 1) / count * np.sum(np.square(without - np.mean(without))))
    return float(np.sum(above) / max(float(np.sum(below)), 1e-12)), float(spread)


def _at(course: Float, joint: int) -> Float:
    return np.asarray(course[:, joint] if course.ndim == 2 else course)


def blocks_of(problem: Problem) -> NDArray[np.intp]:
    """Number of the block of each fitted row, (N,): about ``BLOCK`` s each, counted over all runs."""
    out, first = [], 0
    for states, part in zip(problem.states, problem.target, strict=True):
        rows = len(part)
        count = max(1, round((states.time[-1] - states.time[0]) / BLOCK))
        out.append(first + np.minimum(np.arange(rows) * count // max(rows, 1), count - 1))
        first += count
    return np.concatenate(out)


def rms(residual: Float) -> Float:
    """Root mean square (C,) of a residual (N, C)."""
    return np.asarray(np.sqrt(np.mean(np.square(residual), axis=0)))
