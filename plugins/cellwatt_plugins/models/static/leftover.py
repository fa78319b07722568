"""Residual of the physics, learned from neighbouring poses: a Gaussian process for each joint's torque.

Squared-exponential kernel over the joint angles; its length and each joint's size and noise are the most probable ones
(Rasmussen, Williams, Gaussian Processes for Machine Learning, 2006, ch. 5). One eigendecomposition serves all joints,
sizes and noises; scikit-learn's process factorises the kernel for each of them, and takes twenty times as long for the
same error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

_LENGTHS: Final = (0.5, 0.8, 1.3, 2.0)  # of half a joint's range
_RATIOS: Final = np.geomspace(1e-3, 1e2, 41)  # size² / noise²


@dataclass(frozen=True)
class Leftover:
    """A sum of Gaussians centred at the poses of the training."""

    centres: Float
    """(M, n): joint angles, −1 … 1 within the limits."""
    length: float
    weights: Float
    """(M, n) Nm."""

    def __call__(self, share: Any) -> Any:
        """Torques (N, n) Nm at joint angles ``share`` (N, n), −1 … 1 within the limits; of an array or a ``Tensor``."""
        return _kernel(share, self.centres, self.length) @ self.weights


def learned(share: Float, rest: Float, used: NDArray[np.bool_]) -> Leftover:
    """Learn the residuals ``rest`` (N, n) Nm at joint angles ``share`` (N, n), in poses ``used`` (N, n) at all
    joints."""
    rows = used.all(axis=1)
    share, rest = share[rows], rest[rows]
    candidates = [_of_length(share, rest, length) for length in _LENGTHS]
    return max(candidates, key=lambda found: found[0])[1]


def _of_length(share: Float, rest: Float, length: float) -> tuple[float, Leftover]:
    """Log evidence, and the process of this length with the best size and noise for each joint."""
    values, vectors = np.linalg.eigh(_kernel(share, share, length))
    turned = vectors.T @ rest
    total, weights = 0.0, np.empty_like(rest)
    for joint in range(rest.shape[1]):
        spread = _RATIOS[:, None] * np.maximum(values, 0.0) + 1.0
        noise = np.mean(turned[:, joint] ** 2 / spread, axis=1)
        evidence = -0.5 * (len(values) * np.log(noise) + np.log(spread).sum(axis=1))
        best = int(np.argmax(evidence))
        total += float(evidence[best])
        weights[:, joint] = vectors @ (_RATIOS[best] * turned[:, joint] / spread[best])
    return total, Leftover(share, length, weights)


def _kernel(a: Any, b: Float, length: float) -> Any:
    square = (a * a).sum(axis=-1, keepdims=True) + np.sum(b**2, axis=1) - a @ (2 * b.T)
    return np.exp(-0.5 / length**2 * np.maximum(square, 0.0))
