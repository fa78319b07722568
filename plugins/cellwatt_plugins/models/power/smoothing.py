"""Position, velocity and acceleration from noisy encoders: local polynomials through position and velocity together.

Savitzky and Golay (Analytical Chemistry 36, 1964) with both channels, each weighed by its noise. The weights are
constant:
the model file multiplies the window by them.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.onnx_graph import Tensor

DIFFERENCES = 4
"""Order of the differences from which noise is estimated: a smooth motion has none of this order."""
LEAST_NOISE = 1e-8
AT_ONCE = 20_000
"""Number of rows whose windows are in memory together."""


@dataclass(frozen=True)
class Noise:
    """Standard deviations of the encoders' noise."""

    position: float
    """rad."""
    velocity: float
    """rad/s."""

    @classmethod
    def of(cls, moves: Moves) -> Noise:
        """Estimate from the moves: the median over all joints."""
        return cls(float(np.median(noise_of(moves.q))), float(np.median(noise_of(moves.qd))))


def noise_of(values: Float) -> Float:
    """Return the standard deviation (c,) of white noise in columns (N, c) of moves; NaN for columns without values."""
    return np.maximum(white_noise(values, DIFFERENCES), LEAST_NOISE)


@dataclass(frozen=True)
class Span:
    """A window that reaches equally far to both sides: its rows, and the order of its polynomial."""

    rows: int
    order: int


@dataclass(frozen=True)
class Smoother:
    """Weights (3, 2 · window) for q, q̇, q̈ of the window's positions and velocities, which alternate row by row.

    The newest row of the window is ``delay`` rows after the estimated one.
    """

    weights: Float
    window: int
    delay: int

    @classmethod
    def design(cls, noise: Noise, step: float, velocity: Span, acceleration: Span) -> Smoother:
        """Position and velocity by one span, acceleration by another; both reach as far ahead as back."""
        window = max(velocity.rows, acceleration.rows)
        delay = (window - 1) // 2
        weights = np.zeros((3, window, 2))
        for span, which in ((velocity, slice(0, 2)), (acceleration, slice(2, 3))):
            first = (window - span.rows) // 2
            times = step * (np.arange(span.rows, dtype=np.float64) + first - (window - 1 - delay))
            weights[which, first : first + span.rows] = _weights(times, span.order, noise)[which]
        return cls(weights.reshape(3, -1), window, delay)

    def apply(self, moves: Moves) -> tuple[Float, Float, Float]:
        """q, q̇, q̈ (N, n) each; beyond the ends of a move its first and last row are held."""
        out = np.empty((3, *moves.q.shape))
        for first, end in moves.bounds():
            for some in range(first, end, AT_ONCE):
                last = min(some + AT_ONCE, end)
                rows = np.arange(some, last)[:, None] + np.arange(1 - self.window, 1) + self.delay
                rows = np.clip(rows, first, end - 1)
                seen = np.stack([moves.q[rows], moves.qd[rows]], axis=2).reshape(last - some, 2 * self.window, -1)
                out[:, some:last] = (self.weights @ seen).transpose(1, 0, 2)
        return out[0], out[1], out[2]

    def trace(self, seen: Tensor, joints: int) -> list[Tensor]:
        """The same in a model file, for windows ``seen`` of n positions and n velocities a row: q, q̇, q̈ (N, n)."""
        estimates: Tensor = self.weights @ seen.reshape(-1, 2 * self.window, joints)
        return [part.reshape(-1, joints) for part in estimates.split([1, 1, 1], axis=1)]

    def trace_as_is(self, seen: Tensor, first: int, count: int) -> Tensor:
        """Columns of the estimated row of windows ``seen``, not smoothed: (N, ``count``)."""
        row = self.window - 1 - self.delay
        here = seen if self.window == 1 else seen.part(row, row + 1, axis=1)
        return here.part(first, first + count).reshape(-1, count)

    def whole(self, moves: Moves) -> NDArray[np.bool_]:
        """Rows (N,) whose window lies within their move."""
        out = np.zeros(len(moves), bool)
        for first, end in moves.bounds():
            out[first + self.window - 1 - self.delay : end - self.delay] = True
        return out


def _weights(times: Float, order: int, noise: Noise) -> Float:
    """(3, rows, 2): value, slope and curvature at 0 s of the polynomial through noisy values and slopes."""
    powers = range(order + 1)
    value = np.stack([times**k / factorial(k) for k in powers], axis=1) / noise.position
    slope = np.stack([times ** (k - 1) / factorial(k - 1) if k else 0 * times for k in powers], axis=1) / noise.velocity
    solution = np.linalg.pinv(np.concatenate([value, slope]))
    out = np.zeros((3, len(times), 2))
    known = min(3, order + 1)
    out[:known, :, 0] = solution[:known, : len(times)] / noise.position
    out[:known, :, 1] = solution[:known, len(times) :] / noise.velocity
    return out
