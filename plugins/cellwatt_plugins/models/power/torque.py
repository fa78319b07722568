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
from cellwatt_plugins.robot.regression import Fit, Prior, Products, variance_of

Sums = tuple[Products, ...]
"""Products of each joint's torque with all of its columns: R shared ones and F of its own."""

SPEEDS: Final = (0.003, 0.03)
"""rad/s between rows at rest, near rest and moving, which have their own weights: velocity noise matters near rest."""
FEWEST: Final = 20
"""Fewest rows of such a kind for a noise estimate of its own."""
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
    """Coefficients of the shared columns (R,) and of the chosen terms (T, n); ``chosen`` are indices of these terms."""

    shared: Float
    own: Float
    chosen: tuple[int, ...]

    @classmethod
    def of(cls, x: Float, shared: int, joints: int, chosen: Sequence[int]) -> Solution:
        """Return the solution for a vector of coefficients (p,)."""
        return cls(x[:shared], x[shared:].reshape(joints, len(chosen)).T.copy(), tuple(chosen))

    @property
    def row(self) -> Float:
        """All coefficients (p,) as a vector: shared ones, then the terms of each joint in turn."""
        return np.concatenate([self.shared, self.own.T.ravel()])

    def torque(self, design: Design) -> Float:
        """Torque (N, n) Nm."""
        return np.asarray(
            design.shared @ self.shared + np.einsum("njt,tj->nj", design.own[:, :, list(self.chosen)], self.own)
        )


def together(sums: Sums, shared: int, chosen: Sequence[int]) -> Products:
    """Return the equations of all coefficients (p,), in the order of ``Solution.row``."""
    terms, size = np.arange(len(chosen)), shared + len(sums) * len(chosen)
    of = np.concatenate([np.arange(shared), shared + np.asarray(chosen, np.intp)])
    out = Products(np.zeros((size, size)), np.zeros(size))
    for j, own in enumerate(sums):
        out += own.part(of).placed(np.concatenate([np.arange(shared), shared + j * len(terms) + terms]), size)
    return out


def prior_of(belief: Belief, chosen: Sequence[int]) -> Prior:
    """Return the prior of all coefficients (p,), in the same order."""
    rows = list(chosen)
    return Prior.joined(belief.shared, Prior.spread(belief.own_spread[rows].T.ravel(), belief.own[rows].T.ravel()))


def solve(sums: Sums, belief: Belief, chosen: Sequence[int]) -> Solution:
    """Return the most probable coefficients."""
    shared = len(belief.shared.mean)
    fit = Fit(together(sums, shared, chosen), prior_of(belief, chosen))
    return Solution.of(fit.coefficients, shared, len(sums), chosen)


def misfit(sums: Sums, solution: Solution) -> float:
    """Return the mean weighted square of the residuals, over joints and rows."""
    all_rows = together(sums, len(solution.shared), solution.chosen)
    return all_rows.misfit(solution.row) / max(all_rows.rows, 1.0)


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
