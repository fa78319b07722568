"""Bayesian fit of a nearly linear model: selection of the parameters that the data support, and their values.

Each group of parameters has its own spread and each joint its own noise; both are set to the most probable values
(MacKay, Neural Computation 4, 1992), and groups without evidence are left out (Savage–Dickey ratio).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import CellwattError
from cellwatt_plugins.robot.regression import Fit, Prior, Products

Evaluate = Callable[[Float], tuple[Float, Float]]
"""From parameters (P,) to predictions (N, n), and their derivatives (N, n, P)."""

_LINEARISED: Final = 3
_SWEEPS: Final = 8
_BELIEF: Final = 1.0
"""Weight of a group's stated scale, in parameters' worth of evidence."""
_NOISE_BELIEF: Final = 2.0


@dataclass(frozen=True)
class Belief:
    """Prior: groups of parameters by ``slices``, and each parameter's ``scale`` (P,).

    ``needs`` is the evidence (natural log) that each group must have to be included.
    """

    slices: tuple[slice, ...]
    scale: Float
    needs: Float
    noise: Float
    """(n,): noise of each joint's torque, Nm."""
    outputs: tuple[tuple[int, ...], ...]
    """Outputs that each group affects."""


@dataclass(frozen=True)
class Posterior:
    """Posterior: parameters and their covariance after the data."""

    mean: Float
    """(P,); 0 for parameters left out."""
    covariance: Float
    """(P, P)."""
    noise: Float
    """(n,): standard deviation of each joint's measured torque, Nm."""
    active: NDArray[np.bool_]
    """(groups,): true for included groups."""
    gain: Float
    """(groups,): evidence (natural log) of each group."""

    @property
    def deviation(self) -> Float:
        """Standard deviation of each parameter, (P,)."""
        return np.sqrt(np.diag(self.covariance))


def fit(evaluate: Evaluate, measured: Float, used: NDArray[np.bool_], prior: Belief) -> Posterior:
    """Fit to ``measured`` (N, n) where ``used`` (N, n) is true.

    Raises ``CellwattError`` if the poses do not determine a model.
    """
    search = _Search(prior)
    try:
        for _ in range(_LINEARISED):
            search.sweep(_sums(evaluate, measured, used, search.mean))
        sums = _sums(evaluate, measured, used, search.mean)
        while (dropped := search.not_asked_for()).any():
            search.active &= ~dropped
            search.sweep(sums)
        for _ in range(2):
            search.sweep(_sums(evaluate, measured, used, search.mean))
    except np.linalg.LinAlgError as error:
        raise CellwattError("the poses do not determine a model: are they all the same?") from error
    covariance = np.zeros((len(prior.scale), len(prior.scale)))
    covariance[np.ix_(search.on, search.on)] = search.fit.covariance
    return Posterior(search.mean, covariance, search.noise, search.active, search.gains())


def _sums(evaluate: Evaluate, measured: Float, used: NDArray[np.bool_], mean: Float) -> list[Products]:
    """Equations of each joint's torque, linearised about ``mean`` (P,)."""
    predicted, slopes = evaluate(mean)
    values = measured - predicted + slopes @ mean
    return [Products.of(slopes[rows, j], values[rows, j]) for j, rows in enumerate(used.T)]


class _Search:
    """Parameters, spreads of their groups and noise of each joint, as estimated so far."""

    fit: Fit

    def __init__(self, prior: Belief) -> None:
        self.prior, self.noise = prior, prior.noise.copy()
        self.spread, self.active = np.ones(len(prior.slices)), np.ones(len(prior.slices), dtype=np.bool_)
        self.mean = np.zeros(len(prior.scale))
        self._width = np.array([part.stop - part.start for part in prior.slices])

    @property
    def on(self) -> NDArray[np.intp]:
        """Indices of the parameters that are included."""
        return np.flatnonzero(np.repeat(self.active, self._width))

    def sweep(self, sums: Sequence[Products]) -> None:
        """Estimate parameters from spreads and noises, and these from the parameters, in turn."""
        on, count = self.on, len(self._width)
        owner, scale = np.repeat(np.arange(count), self._width)[on], self.prior.scale[on]
        parts = [each.part(on) for each in sums]
        for _ in range(_SWEEPS):
            weight = 1.0 / self.noise**2
            within = Prior.spread(scale * self.spread[owner])
            gram = np.tensordot(weight, np.stack([part.gram for part in parts]), 1)
            self.fit = Fit(Products(gram, weight @ np.stack([part.pull for part in parts])), within)
            found, covariance = self.fit.coefficients, self.fit.covariance
            determined = 1.0 - np.diag(covariance) / within.deviations**2
            size = np.bincount(owner, (found / scale) ** 2, count)
            known = np.bincount(owner, determined, count)
            self.spread = np.sqrt((size + _BELIEF) / (known + _BELIEF))
            rest = np.array([max(part.misfit(found), 0.0) for part in parts])
            free = np.array([np.vdot(part.gram, covariance) for part in parts]) * weight
            rows = np.array([part.rows for part in parts])
            self.noise = np.sqrt(
                (rest + _NOISE_BELIEF * self.prior.noise**2) / np.maximum(rows - free + _NOISE_BELIEF, _NOISE_BELIEF)
            )
        self.mean = np.zeros(len(self.prior.scale))
        self.mean[on] = found

    def gains(self) -> Float:
        """Evidence (natural log) of each group; 0 for groups left out."""
        ends = np.cumsum(self._width * self.active)
        parts = zip(ends - self._width, ends, self.active, strict=True)
        return np.array([self.fit.gain(slice(int(a), int(b))) if active else 0.0 for a, b, active in parts])

    def not_asked_for(self) -> NDArray[np.bool_]:
        """Groups to leave out next, (groups,): the weakest one, and others that affect none of its outputs.

        Of two equivalent groups, one must be left out before the evidence of the other shows.
        """
        gain = self.gains() - self.prior.needs
        dropped = np.zeros(len(gain), dtype=np.bool_)
        touched: set[int] = set()
        for i in np.argsort(gain):
            if self.active[i] and gain[i] < 0 and touched.isdisjoint(self.prior.outputs[i]):
                dropped[i] = True
                touched.update(self.prior.outputs[i])
        return dropped
