"""Scaled Conjugate Gradient: Møller, A scaled conjugate gradient algorithm for fast supervised learning, Neural
Networks 6 (1993) 525–533; equations (6)–(9) of the paper of power models.

The step size follows from a model of the curvature along the search direction, made positive by λ: no line search.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.progress import steps

SIGMA: Final = 1e-5
"""σ: length of the step with which curvature is measured, times 1/|p|; 0 < σ ≤ 1e-4."""
LAMBDA: Final = 1e-7
"""λ₁; 0 < λ₁ ≤ 1e-6."""
LAMBDA_MOST: Final = 1e30
"""λ above which no direction reduces the value any more."""


def minimise(
    function: Callable[[Float], tuple[float, Float]],
    start: Float,
    iterations: int = 1000,
    tolerance: float = 1e-8,
    watch: Callable[[int, Float], bool] | None = None,
) -> Float:
    """Minimum of a ``function`` that returns its value and gradient.

    Ends if the gradient's norm is below ``tolerance``, after ``iterations``, or if ``watch`` (called with the iteration
    and the point after each step down) returns true. The numbers in comments are the steps of Møller's algorithm 1.
    """
    w = np.array(start, np.float64)
    value, gradient = function(w)
    r = -gradient
    p = r.copy()
    lam, lam_bar, success, delta = LAMBDA, 0.0, True, 0.0
    for k in steps(range(1, iterations + 1), "epoch"):
        if np.linalg.norm(r) <= tolerance or lam > LAMBDA_MOST:
            break
        norm = float(p @ p)
        if success:  # 2: second-order information, eq. (6)
            sigma = SIGMA / np.sqrt(norm)
            delta = float(p @ (function(w + sigma * p)[1] + r)) / sigma
        delta += (lam - lam_bar) * norm  # 3: scale
        if delta <= 0:  # 4: make the curvature positive, eq. (8)
            lam_bar = 2 * (lam - delta / norm)
            delta = -delta + lam * norm
            lam = lam_bar
        mu = float(p @ r)  # 5: step size, eq. (7)
        alpha = mu / delta
        there, slope = function(w + alpha * p)
        comparison = 2 * delta * (value - there) / mu**2 if np.isfinite(there) else -1.0  # 6: eq. (9)
        if success := comparison >= 0:  # 7
            w = w + alpha * p
            before, r, value = r, -slope, there
            lam_bar = 0.0
            restart = k % w.size == 0
            p = r if restart else r + float(r @ r - r @ before) / mu * p
            if float(p @ r) <= 0:
                p = r
            if comparison >= 0.75:
                lam /= 4
            if watch is not None and watch(k, w):
                break
        else:
            lam_bar = lam
        if comparison < 0.25:  # 8
            lam += delta * (1 - comparison) / norm
    return w
