"""Bayesian fit of a model that is nearly linear: which parameters the data ask for, and how large they are.

Each group of parameters has a spread of its own and each joint its own noise; both are set to what makes the data most
probable (MacKay, Neural Computation 4, 1992), and groups that the data do not ask for are left out (Savage–Dickey
ratio).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri

from cellwatt.errors import CellwattError

Float = NDArray[np.float64]
Evaluate = Callable[[Float], tuple[Float, Float]]
"""From parameters (P,) to what they predict (N, n), and its slopes (N, n, P)."""

_LINEARISED: Final = 3
_SWEEPS: Final = 8
_BELIEF: Final = 1.0
"""How many parameters' worth of evidence the stated scale of a group is."""
_NOISE_BELIEF: Final = 2.0


@dataclass(frozen=True)
class Prior:
    """What is thought before the data: groups of parameters by ``slices``, each parameter's ``scale`` (P,).

    ``needs`` says by how much (natural log) a group must make the data more probable to be taken in.
    """

    slices: tuple[slice, ...]
    scale: Float
    needs: Float
    noise: Float
    """(n,)."""
    outputs: tuple[tuple[int, ...], ...]
    """Which outputs each group changes."""


@dataclass(frozen=True)
class Posterior:
    """What is known after the data."""

    mean: Float
    """(P,); 0 where left out."""
    covariance: Float
    """(P, P)."""
    noise: Float
    """(n,): standard deviation of each joint's measured torque, Nm."""
    active: NDArray[np.bool_]
    """(groups,): taken in."""
    gain: Float
    """(groups,): by how much (natural log) each makes the data more probable."""
    spread: Float
    """(groups,): size of each group, in multiples of its scale."""

    @property
    def deviation(self) -> Float:
        """Standard deviation of each parameter, (P,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass
class _State:
    mean: Float
    covariance: Float
    noise: Float
    spread: Float
    active: NDArray[np.bool_]


def fit(evaluate: Evaluate, measured: Float, used: NDArray[np.bool_], prior: Prior) -> Posterior:
    """Fit to ``measured`` (N, n), where ``used`` (N, n)."""
    count = len(prior.slices)
    wide = np.diag(prior.scale**2)
    state = _State(np.zeros(len(prior.scale)), wide, prior.noise.copy(), np.ones(count), np.ones(count, dtype=np.bool_))
    for _ in range(_LINEARISED):
        _sweep(state, _Sums.of(evaluate, measured, used, state.mean), prior, _SWEEPS)
    sums = _Sums.of(evaluate, measured, used, state.mean)
    while (dropped := _not_asked_for(state, prior)).any():
        state.active &= ~dropped
        _sweep(state, sums, prior, _SWEEPS)
    for _ in range(2):
        _sweep(state, _Sums.of(evaluate, measured, used, state.mean), prior, _SWEEPS)
    return Posterior(state.mean, state.covariance, state.noise, state.active, _gains(state, prior), state.spread)


def _not_asked_for(state: _State, prior: Prior) -> NDArray[np.bool_]:
    """Groups to leave out next, (groups,): the weakest, and others that have nothing to do with it.

    Where two say the same, one of them must be left out before the other shows what it is worth.
    """
    gain = _gains(state, prior) - prior.needs
    dropped = np.zeros(len(gain), dtype=np.bool_)
    touched: set[int] = set()
    for i in np.argsort(gain):
        if state.active[i] and gain[i] < 0 and touched.isdisjoint(prior.outputs[i]):
            dropped[i] = True
            touched.update(prior.outputs[i])
    return dropped


@dataclass(frozen=True)
class _Sums:
    """Sums over the poses, by joint: slopes by slopes (n, P, P), slopes by values (n, P), values squared, counts."""

    matrix: Float
    vector: Float
    square: Float
    count: Float

    @classmethod
    def of(cls, evaluate: Evaluate, measured: Float, used: NDArray[np.bool_], mean: Float) -> _Sums:
        predicted, slopes = evaluate(mean)
        values = np.where(used, measured - predicted, 0.0) + np.where(used, slopes @ mean, 0.0)
        masked = np.moveaxis(np.where(used[:, :, None], slopes, 0.0), 1, 0)
        turned = np.swapaxes(masked, 1, 2)
        return cls(
            turned @ masked,
            (turned @ values.T[:, :, None])[:, :, 0],
            np.sum(values**2, axis=0),
            np.sum(used, axis=0).astype(np.float64),
        )


def _sweep(state: _State, sums: _Sums, prior: Prior, times: int) -> None:
    """Parameters for the spreads and noises, and those for the parameters, in turn."""
    on = np.zeros(len(prior.scale), dtype=bool)
    for active, part in zip(state.active, prior.slices, strict=True):
        on[part] = active
    matrix, vector, scale = sums.matrix[:, on][:, :, on], sums.vector[:, on], prior.scale[on]
    width = np.array([part.stop - part.start for part in prior.slices])
    owner = np.repeat(np.arange(len(width)), width)[on]
    in_a_row = matrix.reshape(len(matrix), -1)
    product: Float | None = None  # kept: a new one of a megabyte each time takes longer than the product itself
    for _ in range(times):
        weight = 1.0 / state.noise**2
        precision = 1.0 / (scale * state.spread[owner]) ** 2
        weighed = np.dot(weight[None, :], in_a_row).reshape(matrix.shape[1:])
        covariance = _inverse(weighed + np.diag(precision))
        mean = covariance @ (weight @ vector)
        determined = 1.0 - np.diag(covariance) * precision
        size = np.bincount(owner, (mean / scale) ** 2, len(width))
        known = np.bincount(owner, determined, len(width))
        state.spread = np.sqrt((size + _BELIEF) / (known + _BELIEF))
        rest = sums.square - 2 * vector @ mean + (matrix @ mean) @ mean
        product = np.multiply(matrix, covariance, out=product)
        free = np.sum(product, axis=(1, 2)) * weight
        state.noise = np.sqrt(
            (np.maximum(rest, 0) + _NOISE_BELIEF * prior.noise**2)
            / np.maximum(sums.count - free + _NOISE_BELIEF, _NOISE_BELIEF)
        )
    state.mean = np.zeros(len(on))
    state.mean[on] = mean
    state.covariance = np.zeros((len(on), len(on)))
    state.covariance[np.ix_(on, on)] = covariance


def _inverse(matrix: Float) -> Float:
    """Of a symmetric positive definite matrix (P, P)."""
    factor, failed = dpotrf(matrix, lower=True)
    lower, failed = (factor, failed) if failed else dpotri(factor, lower=True)
    if failed:
        raise CellwattError("the poses do not determine a model: are they all the same?")
    whole = lower + lower.T  # above the diagonal, it is zero
    np.fill_diagonal(whole, np.diag(lower))
    return np.asarray(whole)


def _gains(state: _State, prior: Prior) -> Float:
    """Natural log of how much more probable each group makes the data; 0 for those left out."""
    out = np.zeros(len(prior.slices))
    for i, part in enumerate(prior.slices):
        if state.active[i]:
            block, mean = state.covariance[part, part], state.mean[part]
            wide = (prior.scale[part] * state.spread[i]) ** 2
            narrowed = np.linalg.slogdet(block)[1] - np.sum(np.log(wide))
            out[i] = 0.5 * (narrowed + mean @ np.linalg.solve(block, mean))
    return out
