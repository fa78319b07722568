"""Bayesian comparison of explanations that are linear in their sizes.

With y ~ N(0, Σ), Σ = diag(noise²) + B Bᵀ (harmless variation, columns scaled to one standard deviation), an
explanation adds columns C whose sizes are N(0, 1) before the data. Its log evidence over none is
½ bᵀ (I + G)⁻¹ b − ½ log det(I + G) with G = Cᵀ Σ⁻¹ C, b = Cᵀ Σ⁻¹ y (MacKay, Information Theory, ch. 28).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

FAINT = 1e-6
"""Harmless variation of less than this share of the noise's variance is left out."""


@dataclass(frozen=True)
class Whitener:
    """Σ^(-½), by which y and columns become plain least squares; ``log_det`` of Σ relative to the noise alone."""

    noise: Float
    axes: Float
    shrink: Float
    log_det: float
    group: int
    """So many points after each other make one value: their mean."""

    def __call__(self, columns: Float) -> Float:
        """Σ^(-½) of one (N,) or several columns (N, k)."""
        scaled = (means(columns, self.group).T / self.noise).T
        shared = self.axes.T @ scaled
        return np.asarray(scaled - self.axes @ (self.shrink * shared.T).T)


def means(points: Float, group: int) -> Float:
    """Mean of each ``group`` of points (N,) or (N, k)."""
    return points if group == 1 else points.reshape(-1, group, *points.shape[1:]).mean(axis=1)


def whitener(noise: Float, harmless: Float, group: int = 1) -> Whitener:
    """Σ^(-½) for ``noise`` (N,) and ``harmless`` columns (N, h) at points, of which ``group`` make one value each."""
    noise = means(noise, group)
    scaled = means(harmless, group) / noise[:, None]
    tall = scaled.shape[0] >= scaled.shape[1]
    strength, turn = np.linalg.eigh(scaled.T @ scaled if tall else scaled @ scaled.T)
    strong = strength > max(FAINT, 1e-12 * strength.max(initial=0.0))
    strength, turn = strength[strong], turn[:, strong]
    axes = (scaled @ turn) / np.sqrt(strength) if tall else turn
    return Whitener(noise, axes, 1.0 - 1.0 / np.sqrt(1.0 + strength), float(np.log1p(strength).sum()), group)


@dataclass(frozen=True)
class Gram:
    """Products of all candidate columns (k) under Σ⁻¹: ``inner`` (k, k) among each other, ``pull`` (k,) with y."""

    inner: Float
    pull: Float
    misfit: float
    """yᵀ Σ⁻¹ y."""


@dataclass(frozen=True)
class Fit:
    """``gain`` log evidence over none, ``sizes`` (m,) of the chosen columns and their ``error`` (m,)."""

    gain: float
    sizes: Float
    error: Float


def gram(residual: Float, columns: Float, noise: Float, harmless: Float, group: int = 1) -> Gram:
    """Products for ``residual`` (N,), candidate ``columns`` (N, k), ``noise`` (N,), ``harmless`` columns (N, h)."""
    white = whitener(noise, harmless, group)
    return products(white(residual), white(columns))


def products(residual: Float, columns: Float) -> Gram:
    """The same of what is white already."""
    return Gram(columns.T @ columns, columns.T @ residual, float(residual @ residual))


def fit(products: Gram, chosen: NDArray[np.intp]) -> Fit:
    """The evidence and sizes of the ``chosen`` columns together."""
    inner = np.eye(len(chosen)) + products.inner[np.ix_(chosen, chosen)]
    pull = products.pull[chosen]
    inverse = np.linalg.inv(inner)
    sizes = inverse @ pull
    gain = 0.5 * float(pull @ sizes) - 0.5 * float(np.linalg.slogdet(inner)[1])
    return Fit(gain, sizes, np.sqrt(np.diag(inverse)))
