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


def gram(residual: Float, columns: Float, noise: Float, harmless: Float) -> Gram:
    """Products for ``residual`` (N,), candidate ``columns`` (N, k), ``noise`` (N,), ``harmless`` columns (N, h)."""
    scaled = np.column_stack([columns, residual]) / noise[:, None]
    nuisance = harmless / noise[:, None]
    shared = nuisance.T @ scaled
    within = np.eye(nuisance.shape[1]) + nuisance.T @ nuisance
    products = scaled.T @ scaled - shared.T @ np.linalg.solve(within, shared)
    return Gram(products[:-1, :-1], products[:-1, -1], float(products[-1, -1]))


def fit(products: Gram, chosen: NDArray[np.intp]) -> Fit:
    """The evidence and sizes of the ``chosen`` columns together."""
    inner = np.eye(len(chosen)) + products.inner[np.ix_(chosen, chosen)]
    pull = products.pull[chosen]
    inverse = np.linalg.inv(inner)
    sizes = inverse @ pull
    gain = 0.5 * float(pull @ sizes) - 0.5 * float(np.linalg.slogdet(inner)[1])
    return Fit(gain, sizes, np.sqrt(np.diag(inverse)))
