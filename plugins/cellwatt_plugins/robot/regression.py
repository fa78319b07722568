"""Linear least squares with normal priors, and the log evidence of the result.

Coefficients x have a normal prior N(m₀, Σ₀), targets y = A x + e normal noise e of known variance. Then x given y is
normal with information Σ₀⁻¹ + Aᵀ W A, and the evidence of the columns is exact: it penalises each free coefficient
(Bishop, Pattern Recognition and Machine Learning, 2006, 3.3 and 3.5). ``blocks`` does the same for a search over many
candidate columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpotri
from scipy.optimize import lsq_linear

from cellwatt.arrays import Float

Index = NDArray[np.intp] | slice

FAINT = 1e-6
"""Shared noise below this share of the independent noise's variance is neglected."""


@dataclass(frozen=True)
class Prior:
    """Normal prior of k coefficients: mean (k,), covariance (k, k), positive definite."""

    mean: Float
    covariance: Float

    @classmethod
    def spread(cls, deviations: Float, mean: Float | float = 0.0) -> Prior:
        """Return the prior of independent coefficients with standard ``deviations`` (k,) about ``mean``."""
        variance = np.square(deviations)
        prior = cls(np.broadcast_to(np.asarray(mean, np.float64), len(variance)), np.diag(variance))
        prior.__dict__["precision"] = np.diag(1 / variance)
        return prior

    @classmethod
    def joined(cls, *parts: Prior) -> Prior:
        """Return the prior of all coefficients of independent ``parts``, one after the other."""
        whole = cls(
            np.concatenate([np.empty(0), *(part.mean for part in parts)]),
            _diagonal([part.covariance for part in parts]),
        )
        whole.__dict__["precision"] = _diagonal([part.precision for part in parts])
        return whole

    @cached_property
    def deviations(self) -> Float:
        """Standard deviation (k,) of each coefficient."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def precision(self) -> Float:
        """Inverse (k, k) of the covariance."""
        scale = self.deviations
        scaled = self.covariance / np.outer(scale, scale)
        return np.asarray(np.linalg.inv(scaled) / np.outer(scale, scale))


@dataclass(frozen=True)
class Products:
    """Normal equations of weighted least squares: a fit needs no more of its rows. Products of disjoint rows add up."""

    gram: Float
    """Aᵀ W A, (k, k)."""
    pull: Float
    """Aᵀ W y, (k,)."""
    square: float = 0.0
    """yᵀ W y."""
    rows: float = 0.0
    """Number of rows."""

    @classmethod
    def of(cls, matrix: Float, target: Float, variance: Float | float = 1.0) -> Products:
        """Return the products of ``matrix`` (N, k) with ``target`` (N,); ``variance`` (N,) is each target's noise."""
        root = 1 / np.sqrt(np.broadcast_to(variance, len(target)))
        columns, values = matrix * root[:, None], target * root
        return cls(columns.T @ columns, columns.T @ values, float(values @ values), float(len(values)))

    def __add__(self, other: Products) -> Products:
        return Products(
            self.gram + other.gram, self.pull + other.pull, self.square + other.square, self.rows + other.rows
        )

    def __sub__(self, other: Products) -> Products:
        return self + Products(-other.gram, -other.pull, -other.square, -other.rows)

    def part(self, chosen: Index) -> Products:
        """Return the products of the ``chosen`` columns alone."""
        return Products(self.gram[chosen][:, chosen], self.pull[chosen], self.square, self.rows)

    def placed(self, at: Index, size: int) -> Products:
        """Return the same equations among ``size`` columns: these columns ``at`` their positions, all others 0."""
        gram, pull = np.zeros((size, size)), np.zeros(size)
        gram[np.ix_(at, at) if isinstance(at, np.ndarray) else (at, at)] = self.gram
        pull[at] = self.pull
        return Products(gram, pull, self.square, self.rows)

    def misfit(self, coefficients: Float) -> float:
        """Return the weighted sum of squared residuals with ``coefficients`` (k,)."""
        return float(self.square - 2 * coefficients @ self.pull + coefficients @ self.gram @ coefficients)


class Fit:
    """Posterior of the coefficients under ``products`` and ``prior``.

    Raises ``numpy.linalg.LinAlgError`` if the two do not determine the coefficients.
    """

    def __init__(self, products: Products, prior: Prior) -> None:
        self.products, self.prior = products, prior
        information = products.gram + prior.precision
        self.scale = 1 / np.sqrt(np.diag(information))
        """(k,) by which coefficients are scaled to one size, for numerical conditioning."""
        self._factor = cho_factor(information * np.outer(self.scale, self.scale), lower=True)
        self.coefficients = self.solved(products.pull + prior.precision @ prior.mean)
        """Posterior mean (k,)."""

    def solved(self, right: Float) -> Float:
        """Return the posterior covariance times ``right`` (k,) or (k, m)."""
        return np.asarray((self.scale * cho_solve(self._factor, (self.scale * right.T).T).T).T)

    @cached_property
    def covariance(self) -> Float:
        """Posterior covariance (k, k)."""
        lower = np.tril(dpotri(self._factor[0], lower=True)[0])
        return np.asarray((lower + np.tril(lower, -1).T) * np.outer(self.scale, self.scale))

    @property
    def deviations(self) -> Float:
        """Posterior standard deviation (k,) of each coefficient."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def evidence(self) -> float:
        """Log evidence (nats) of these columns over a model without columns."""
        products = self.products
        return float(log_evidence(products.gram[None], products.pull[None], [self.prior])[0][0])

    def gain(self, part: slice) -> float:
        """Return the log evidence (nats) that coefficients ``part``, a priori independent of the others, add to these.

        Savage and Dickey's ratio (Verdinelli, Wasserman, JASA 90, 1995).
        """
        own = Prior(self.prior.mean[part], self.prior.covariance[part, part])
        information = np.linalg.inv(self.covariance[part, part])
        pull = information @ self.coefficients[part] - own.precision @ own.mean
        return float(log_evidence((information - own.precision)[None], pull[None], [own])[0][0])

    def bounded(self, lower: Float, upper: Float | float = np.inf) -> Float:
        """Return the most probable coefficients (k,) between ``lower`` and ``upper`` (k,), infinite where unbounded."""
        if np.all((self.coefficients >= lower) & (self.coefficients <= upper)):
            return self.coefficients
        root = np.tril(self._factor[0]).T
        found = lsq_linear(
            root, root @ (self.coefficients / self.scale), (lower / self.scale, upper / self.scale), method="bvls"
        )
        return np.asarray(found.x * self.scale)


def solve(matrix: Float, target: Float, variance: Float | float, prior: Prior) -> Fit:
    """Fit ``matrix`` (N, k) to ``target`` (N,) whose noise has the ``variance`` (N,), or one number."""
    return Fit(Products.of(matrix, target, variance), prior)


def gauss_newton(
    linearised: Callable[[Float], Products],
    prior: Prior,
    start: Float,
    rounds: int,
    settled: float = 0.0,
    within: Callable[[Fit], Float] = lambda fit: fit.coefficients,
) -> tuple[Float, Fit]:
    """Fit a nonlinear model: coefficients (k,) and the last linear fit, after at most ``rounds``.

    ``linearised`` gives the equations about coefficients x: slopes J (N, k) and the target y - f(x) + J x. The rounds
    end when a step is below ``settled`` standard deviations of the prior; ``within`` gives the possible coefficients of
    each linear fit.
    """
    found = start
    for _ in range(rounds):
        fit = Fit(linearised(found), prior)
        before, found = found, within(fit)
        if np.abs((found - before) / prior.deviations).max() < settled:
            break
    return found, fit


def log_evidence(information: Float, pull: Float, priors: Sequence[Prior]) -> tuple[Float, Float]:
    """Return the log evidence (K,) in nats over no column, and the posterior means (K, m), of K sets of m columns.

    ``information`` (K, m, m) and ``pull`` (K, m) are those of the data on each set alone, all other columns projected
    out: ½ (b + Σ₀⁻¹m₀)ᵀ x - ½ m₀ᵀ Σ₀⁻¹ m₀ - ½ ln det(1 + Σ₀ G) (Bishop 2006, 3.86).
    """
    information = (information + information.transpose(0, 2, 1)) / 2
    covariance = np.stack([prior.covariance for prior in priors])
    expected = np.stack([prior.mean for prior in priors])
    precision = np.stack([prior.precision for prior in priors])
    pulled = np.einsum("kij,kj->ki", precision, expected)
    right = pull + pulled
    mean = np.linalg.solve(information + precision, right[:, :, None])[:, :, 0]
    _, volume = np.linalg.slogdet(np.eye(pull.shape[1]) + covariance @ information)
    gain = 0.5 * np.sum(right * mean, axis=1) - 0.5 * np.sum(expected * pulled, axis=1) - 0.5 * volume
    return np.asarray(gain), np.asarray(mean)


def variance_of(residual: Float, group: NDArray[np.intp], least: Float | float, fewest: int = 1) -> Float:
    """Return the variance (N,) of each row for the next fit: the mean square of its group's ``residual`` (N,).

    ``group`` (N,) counts from 0. The variance is at least ``least``; groups of fewer than ``fewest`` rows get that of
    all rows. NaN residuals are ignored.
    """
    known = np.isfinite(residual)
    square = np.where(known, residual, 0.0) ** 2
    count = np.bincount(group, known)
    mean = np.bincount(group, square) / np.maximum(count, 1)
    every = float(square.sum() / known.sum()) if known.any() else 1.0
    return np.asarray(np.maximum(np.where(count >= fewest, mean, every)[group], least))


@dataclass(frozen=True)
class Whitener:
    """Σ^(-½) for noise with covariance Σ = diag(noise²) + B Bᵀ; whitened values have independent noise of variance
    1."""

    noise: Float
    """Standard deviation (N,) of each value's independent noise."""
    axes: Float
    shrink: Float
    log_det: float
    """ln det Σ relative to that of the independent noise alone."""
    group: int
    """Number of consecutive rows whose mean is one value."""

    @classmethod
    def of(cls, noise: Float, shared: Float, group: int = 1) -> Whitener:
        """Return the whitener for ``noise`` (N group,) and ``shared`` noise (N group, h), the columns of B.

        Each column is one standard deviation of a noise that all rows share.
        """
        noise = _means(noise, group)
        scaled = _means(shared, group) / noise[:, None]
        tall = scaled.shape[0] >= scaled.shape[1]
        strength, turn = np.linalg.eigh(scaled.T @ scaled if tall else scaled @ scaled.T)
        strong = strength > max(FAINT, 1e-12 * strength.max(initial=0.0))
        strength, turn = strength[strong], turn[:, strong]
        axes = (scaled @ turn) / np.sqrt(strength) if tall else turn
        return cls(noise, axes, 1.0 - 1.0 / np.sqrt(1.0 + strength), float(np.log1p(strength).sum()), group)

    def __call__(self, columns: Float) -> Float:
        """Return Σ^(-½) times one column (N group,) or several (N group, k): N values each."""
        scaled = (_means(columns, self.group).T / self.noise).T
        along = self.axes.T @ scaled
        return np.asarray(scaled - self.axes @ (self.shrink * along.T).T)


def _diagonal(blocks: Sequence[Float]) -> Float:
    """Square ``blocks`` along the diagonal of one matrix; scipy's own is too slow for a search, which joins many."""
    size, at = sum(len(block) for block in blocks), 0
    out = np.zeros((size, size))
    for block in blocks:
        out[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return out


def _means(rows: Float, group: int) -> Float:
    return rows if group == 1 else rows.reshape(-1, group, *rows.shape[1:]).mean(axis=1)
