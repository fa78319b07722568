"""Least squares with priors for the torque columns, on sums over the rows alone; which effects are there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.models.power.design import Belief, Design
from cellwatt_plugins.models.power.terms import ALWAYS

Float = NDArray[np.float64]

SPEEDS: Final = (0.003, 0.03)
"""rad/s: rows at rest, turning and moving are weighed apart, as noise in velocity tells near rest only."""
GAIN: Final = 0.995
"""An effect must bring the held-out error down to this share of its square."""
HARM: Final = 1.02
"""And raise it nowhere above this."""
TRIED: Final = 4
"""Effects that are tried on held-out moves in each round, those that fit best."""


@dataclass(frozen=True)
class Sums:
    """Weighed products of the columns with each other and with the torque; C = R + F columns, n joints."""

    products: Float
    """(n, C, C)."""
    targets: Float
    """(n, C)."""
    squares: Float
    """(n,)."""
    rows: Float
    """(n,)."""

    @classmethod
    def of(cls, design: Design, torque: Float, variance: Float, kept: NDArray[np.bool_]) -> Sums:
        """Of some rows; those without a torque are left out."""
        out = []
        for j in range(torque.shape[1]):
            there = kept & np.isfinite(torque[:, j])
            weight = 1 / np.sqrt(variance[there, j])
            columns = np.concatenate([design.shared[there, j], design.own[there, j]], axis=1) * weight[:, None]
            y = torque[there, j] * weight
            out.append((columns.T @ columns, columns.T @ y, y @ y, float(len(y))))
        products, targets, squares, rows = zip(*out, strict=True)
        return cls(np.array(products), np.array(targets), np.array(squares), np.array(rows))

    def __add__(self, other: Sums) -> Sums:
        return Sums(
            self.products + other.products,
            self.targets + other.targets,
            self.squares + other.squares,
            self.rows + other.rows,
        )

    def __sub__(self, other: Sums) -> Sums:
        return self + Sums(-other.products, -other.targets, -other.squares, -other.rows)


@dataclass(frozen=True)
class Solution:
    """Numbers of the shared columns (R,) and of the chosen terms (T, n), ``chosen`` by their place among all."""

    shared: Float
    own: Float
    chosen: tuple[int, ...]

    def torque(self, design: Design) -> Float:
        """(N, n) Nm."""
        return np.asarray(
            design.shared @ self.shared + np.einsum("njt,tj->nj", design.own[:, :, list(self.chosen)], self.own)
        )


def layout(sums: Sums, shared: int, chosen: Sequence[int]) -> tuple[Float, Float]:
    """Products (p, p) and targets (p,) of all unknowns: shared ones, then the terms of each joint in turn."""
    joints, terms = len(sums.rows), len(chosen)
    size = shared + joints * terms
    matrix, vector = np.zeros((size, size)), np.zeros(size)
    for j in range(joints):
        at = np.concatenate([np.arange(shared), shared + j * terms + np.arange(terms)])
        of = np.concatenate([np.arange(shared), shared + np.asarray(chosen, np.intp)])
        matrix[np.ix_(at, at)] += sums.products[j][np.ix_(of, of)]
        vector[at] += sums.targets[j][of]
    return matrix, vector


def believed(belief: Belief, chosen: Sequence[int]) -> tuple[Float, Float]:
    """Means and spreads (p,) in the same order."""
    rows = list(chosen)
    return (
        np.concatenate([belief.shared, belief.own[rows].T.ravel()]),
        np.concatenate([belief.shared_spread, belief.own_spread[rows].T.ravel()]),
    )


def solve(sums: Sums, belief: Belief, chosen: Sequence[int]) -> Solution:
    """The most probable numbers."""
    shared = len(belief.shared)
    matrix, vector = layout(sums, shared, chosen)
    mean, spread = believed(belief, chosen)
    scaled = spread[:, None] * matrix * spread + np.eye(len(mean))
    x = mean + spread * np.linalg.solve(scaled, spread * (vector - matrix @ mean))
    return split(x, shared, len(sums.rows), chosen)


def split(x: Float, shared: int, joints: int, chosen: Sequence[int]) -> Solution:
    """A solution from its unknowns in a row."""
    return Solution(x[:shared], x[shared:].reshape(joints, len(chosen)).T.copy(), tuple(chosen))


def misfit(sums: Sums, solution: Solution) -> float:
    """Mean weighed square of what is left, over joints and rows."""
    total = 0.0
    of = np.concatenate([np.arange(len(solution.shared)), len(solution.shared) + np.asarray(solution.chosen, np.intp)])
    for j in range(len(sums.rows)):
        x = np.concatenate([solution.shared, solution.own[:, j]])
        total += sums.squares[j] - 2 * x @ sums.targets[j][of] + x @ sums.products[j][np.ix_(of, of)] @ x
    return float(total / max(sums.rows.sum(), 1.0))


def variance_of(left: Float, qd: Float, least: Float) -> Float:
    """Variance (N, n) of what is left: one number a joint for rest, turning and moving each."""
    out = np.empty_like(left)
    speed = np.digitize(np.abs(qd), SPEEDS)
    for j in range(left.shape[1]):
        overall = np.nanmean(left[:, j] ** 2) if np.isfinite(left[:, j]).any() else 1.0
        for k in range(len(SPEEDS) + 1):
            rows = speed[:, j] == k
            known = rows & np.isfinite(left[:, j])
            size = np.mean(left[known, j] ** 2) if known.sum() >= 20 else overall
            out[rows, j] = max(size, least[j] ** 2)
    return out


@dataclass(frozen=True)
class Folds:
    """Sums over the rows of each fold, and over those of all others."""

    held: tuple[Sums, ...]
    known: tuple[Sums, ...]
    everything: Sums

    @classmethod
    def of(cls, held: Sequence[Sums]) -> Folds:
        """From the sums of each fold."""
        everything = held[0]
        for each in held[1:]:
            everything = everything + each
        return cls(tuple(held), tuple(everything - each for each in held), everything)

    def misfits(self, belief: Belief, chosen: Sequence[int]) -> Float:
        """Misfit of each fold under the solution of the others: (folds,)."""
        pairs = zip(self.held, self.known, strict=True)
        return np.array([misfit(held, solve(known, belief, chosen)) for held, known in pairs])


def select(folds: Folds, belief: Belief, names: Sequence[str], effects: dict[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Effects that lower the held-out error, the best first."""
    places = {name: i for i, name in enumerate(names)}
    chosen = [places[name] for name in ALWAYS]
    found: list[str] = []
    now = folds.misfits(belief, chosen)
    while True:
        more = {
            effect: [*chosen, *(places[term] for term in terms if places[term] not in chosen)]
            for effect, terms in effects.items()
            if effect not in found and any(places[term] not in chosen for term in terms)
        }
        fit = {e: misfit(folds.everything, solve(folds.everything, belief, more[e])) for e in more}
        trials = {e: folds.misfits(belief, more[e]) / now for e in sorted(fit, key=lambda e: fit[e])[:TRIED]}
        best = min(trials, key=lambda effect: float(trials[effect].mean()), default=None)
        if best is None or trials[best].mean() > GAIN or trials[best].max() > HARM:
            return tuple(found)
        found.append(best)
        chosen, now = more[best], now * trials[best]
