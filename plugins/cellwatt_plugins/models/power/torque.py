"""Torques of all joints as one least squares with priors, from sums over the rows alone; selection of effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.design import Belief, Design
from cellwatt_plugins.models.power.folds import grown
from cellwatt_plugins.models.power.terms import terms_of
from cellwatt_plugins.robot.regression import Prior, Products, gauss_newton, variance_of

Sums = tuple[Products, ...]
"""Products of each joint's torque with all of its columns: R shared ones and F of its own."""

SPEEDS: Final = (0.003, 0.03)
"""rad/s between rows at rest, near rest and moving, which have their own weights: velocity noise matters near rest."""
FEWEST: Final = 20
"""Fewest rows of such a kind for a noise estimate of its own."""
ROUNDS: Final = 12
"""Largest number of rounds: torque constants multiply the links' torque."""
STILL: Final = 1e-3
"""Step of all coefficients, in prior standard deviations, below which the rounds end."""
TRIED: Final = 4
"""Number of effects, those that fit best, that are tried on held-out moves in each round."""


def sums_of(design: Design, torque: Float, variance: Float, kept: NDArray[np.bool_]) -> Sums:
    """Return the sums over the ``kept`` rows; rows without a torque are left out."""
    out = []
    for j in range(torque.shape[1]):
        rows = kept & np.isfinite(torque[:, j])
        columns = np.concatenate([design.shared[rows, j], design.own[rows, j]], axis=1)
        out.append(Products.of(columns, torque[rows, j], variance[rows, j]))
    return tuple(out)


@dataclass(frozen=True)
class Solution:
    """Coefficients of the shared columns (R,) and of the chosen terms (T, n); ``chosen`` are indices of these terms.

    The first term is the deviation g of the torque constants: a joint's load, S θ, counts (1 + g)-fold.
    """

    shared: Float
    own: Float
    chosen: tuple[int, ...]

    @classmethod
    def of(cls, x: Float, belief: Belief, chosen: Sequence[int]) -> Solution:
        """Return the solution for a vector of coefficients (p,)."""
        shared = len(belief.shared.mean)
        return cls(x[:shared], x[shared:].reshape(-1, len(chosen)).T.copy(), tuple(chosen))

    @property
    def columns(self) -> NDArray[np.intp]:
        """Indices of the shared columns and of the chosen terms' among all columns of a joint."""
        return np.concatenate([np.arange(len(self.shared)), len(self.shared) + np.array(self.chosen, np.intp)])

    @property
    def at_gain(self) -> NDArray[np.intp]:
        """Indices (n,), in ``row``, of the torque constants' deviations."""
        return len(self.shared) + len(self.chosen) * np.arange(self.own.shape[1])

    def linear(self, joint: int) -> Float:
        """Coefficients of a joint's ``columns`` that give its torque."""
        return np.concatenate([self.shared * (1 + self.own[0, joint]), [0.0], self.own[1:, joint]])

    @property
    def row(self) -> Float:
        """All coefficients (p,) as a vector: shared ones, then the terms of each joint in turn."""
        return np.concatenate([self.shared, self.own.T.ravel()])

    def torque(self, design: Design) -> Float:
        """Torque (N, n) Nm."""
        return np.asarray(design.shared @ self.shared + np.einsum("njt,tj->nj", self._columns(design), self.own))

    def slopes(self, design: Design, by_torque: Float) -> Float:
        """Derivatives (N, p), by all coefficients, of a value with the derivatives ``by_torque`` (N, n)."""
        by_shared = np.einsum("nj,njr->nr", by_torque * (1 + self.own[0]), design.shared)
        by_own = by_torque[:, :, None] * self._columns(design)
        return np.concatenate([by_shared, by_own.reshape(len(by_own), -1)], axis=1)

    def _columns(self, design: Design) -> Float:
        """Columns (N, n, T) of the chosen terms; that of the torque constants is the load of this solution."""
        columns = design.own[:, :, list(self.chosen)]
        columns[:, :, 0] = design.shared @ self.shared
        return columns


def prior_of(belief: Belief, chosen: Sequence[int]) -> Prior:
    """Return the prior of all coefficients (p,), in the same order."""
    rows = list(chosen)
    return Prior.joined(belief.shared, Prior.spread(belief.own_spread[rows].T.ravel(), belief.own[rows].T.ravel()))


def about(sums: Sums, solution: Solution) -> Products:
    """Return the equations of all coefficients (p,), in the order of ``Solution.row``, linearised about a solution."""
    shared, terms = np.arange(len(solution.shared)), np.arange(len(solution.chosen))
    size = len(shared) + len(sums) * len(terms)
    out = Products(np.zeros((size, size)), np.zeros(size))
    for j, own in enumerate(sums):
        part = _multiplied(own.part(solution.columns), solution.shared, float(solution.own[0, j]))
        out += part.placed(np.concatenate([shared, len(shared) + j * len(terms) + terms]), size)
    return out


def _multiplied(own: Products, load: Float, gain: float) -> Products:
    """Return a joint's equations if its load is (1 + g) S θ, about the parameters ``load`` (R,) and a ``gain``.

    Its slopes are (1 + g) S by θ and S θ by g, and the target is y + g S θ: all are combinations of the columns S.
    """
    at = len(load)

    def combined(rows: Float) -> Float:
        return np.concatenate([(1 + gain) * rows[:at], [load @ rows[:at]], rows[at + 1 :]])

    pull = own.pull + gain * (own.gram[:, :at] @ load)
    square = own.square + gain * float(load @ (own.pull + pull)[:at])
    return Products(combined(combined(own.gram).T), combined(pull), square, own.rows)


def solve(sums: Sums, belief: Belief, chosen: Sequence[int]) -> Solution:
    """Return the most probable coefficients."""
    prior = prior_of(belief, chosen)

    def linearised(x: Float) -> Products:
        return about(sums, Solution.of(x, belief, chosen))

    return Solution.of(gauss_newton(linearised, prior, prior.mean, ROUNDS, STILL)[0], belief, chosen)


def misfit(sums: Sums, solution: Solution) -> float:
    """Return the mean weighted square of the residuals, over joints and rows."""
    square = sum(own.part(solution.columns).misfit(solution.linear(j)) for j, own in enumerate(sums))
    return float(square / max(sum(own.rows for own in sums), 1.0))


def variance_by_speed(residual: Float, qd: Float, least: Float) -> Float:
    """Return the variance (N, n) of a ``residual``: for each joint one number at rest, near rest and moving."""
    speed = np.digitize(np.abs(qd), SPEEDS)
    joints = zip(residual.T, speed.T, least, strict=True)
    return np.column_stack([variance_of(own, kind, low**2, FEWEST) for own, kind, low in joints])


def _all(folds: Sequence[Sums]) -> Sums:
    """Sums over the rows of all folds."""
    return tuple(sum(rest, first) for first, *rest in zip(*folds, strict=True))


def misfits(folds: Sequence[Sums], belief: Belief, chosen: Sequence[int]) -> Float:
    """Misfit (folds,) of each fold with the solution of the others, from the sums of each."""
    everything = _all(folds)
    known = (tuple(a - b for a, b in zip(everything, held, strict=True)) for held in folds)
    return np.array([misfit(held, solve(rest, belief, chosen)) for held, rest in zip(folds, known, strict=True)])


def select(folds: Sequence[Sums], belief: Belief, names: Sequence[str], effects: Sequence[str]) -> tuple[str, ...]:
    """Effects that lower the held-out error, the best first."""
    everything = _all(folds)

    def columns_of(found: Sequence[str]) -> list[int]:
        return [names.index(term) for term in terms_of(found)]

    def tried(found: Sequence[str]) -> list[str]:
        more = {e: chosen for e in effects if len(chosen := columns_of([*found, e])) > len(columns_of(found))}
        fit = {e: misfit(everything, solve(everything, belief, more[e])) for e in more}
        return sorted(fit, key=lambda e: fit[e])[:TRIED]

    def scores(sets: Sequence[Sequence[str]]) -> list[Float]:
        return [misfits(folds, belief, columns_of(found)) for found in sets]

    return tuple(grown(scores, tried)[0])
