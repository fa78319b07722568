"""The fits that Sabry et al. compares with BEVF (Fig. 12): Gaussian 8, Fourier 8, sum of sines 8, polynomial 9.

The orders are the largest of the paper's tool. Each is brought to its least squares from several starts and the best
is taken, so that the comparison is with what these families can do, not with a poor start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

TERMS = 8
DEGREE = 9
TRIES = 200
"""Candidates for the frequency, or for centre and width, of each new term."""
FLAT = 6.0
"""So many widths from its centre a bell is 0."""
STEPS = 100
"""Steps at most from each start."""


@dataclass(frozen=True)
class _Family:
    """Functions linear in amplitudes (k,) and not in a shape (m,).

    ``columns(t, shape)`` (n, k) are to be weighed by the amplitudes; ``slopes(t, shape, amplitudes)`` (n, m) are
    the derivatives of their sum by the shape.
    """

    columns: Callable[[Float, Float], Float]
    slopes: Callable[[Float, Float, Float], Float]


def fits(t: Float, power: Float) -> Mapping[str, Float]:
    """Name of each family → its fit (n,) W to a pattern ``power`` (n,) W at times t (n,) s."""
    return {
        f"Gaussian {TERMS}": gaussian(t, power),
        f"Fourier {TERMS}": fourier(t, power),
        f"sum of sines {TERMS}": sines(t, power),
        f"polynomial {DEGREE}": polynomial(t, power),
    }


def polynomial(t: Float, power: Float) -> Float:
    """Least squares polynomial of degree 9."""
    fit = np.polynomial.Chebyshev.fit(t, power, DEGREE)
    return np.asarray(fit(t), dtype=np.float64)


def fourier(t: Float, power: Float) -> Float:
    """a_0 + sum over k = 1 … 8 of a_k cos(k w t) + b_k sin(k w t), with w free."""
    candidates = 2 * np.pi / float(np.ptp(t)) * np.geomspace(0.3, 2.0, TRIES)
    start = min(np.split(candidates, TRIES), key=partial(_left, _HARMONICS, t, power))
    return _best(_HARMONICS, t, power, [start])


def sines(t: Float, power: Float) -> Float:
    """Sum over k = 1 … 8 of a_k sin(b_k t + c_k)."""
    turn = 2 * np.pi / float(np.ptp(t))
    evenly = np.asarray(turn * (np.arange(TERMS) + 0.25), dtype=np.float64)
    grown = _grown(_WAVES, t, power, np.split(turn * np.linspace(0.05, 40.0, TRIES), TRIES))
    return _best(_WAVES, t, power, [evenly, grown])


def gaussian(t: Float, power: Float) -> Float:
    """Sum over k = 1 … 8 of a_k exp(-((t - b_k) / c_k)²)."""
    length = float(np.ptp(t))
    spread = t[0] + length * (np.arange(TERMS) + 0.5) / TERMS
    evenly = [np.stack([spread, np.full(TERMS, share / length)], axis=1).ravel() for share in (4.0, 16.0)]
    centres, shares = np.linspace(t[0], t[-1], TRIES // 8), np.geomspace(1.0, 100.0, 8)
    grown = _grown(_BELLS, t, power, [np.array([b, c / length]) for b in centres for c in shares])
    return _best(_BELLS, t, power, [*evenly, grown])


def _harmonics(t: Float, shape: Float) -> Float:
    angles = t[:, None] * shape[0] * np.arange(1, TERMS + 1)
    return np.hstack([np.cos(angles), np.sin(angles), np.ones((len(t), 1))])


def _harmonic_slopes(t: Float, shape: Float, amplitudes: Float) -> Float:
    turned = _harmonics(t, shape) * t[:, None]
    k, cosines, sines_ = np.arange(1, TERMS + 1), amplitudes[:TERMS], amplitudes[TERMS:-1]
    slope = -turned[:, TERMS:-1] @ (k * cosines) + turned[:, :TERMS] @ (k * sines_)
    return np.asarray(slope[:, None])


def _waves(t: Float, shape: Float) -> Float:
    angles = t[:, None] * shape
    return np.hstack([np.cos(angles), np.sin(angles)])


def _wave_slopes(t: Float, shape: Float, amplitudes: Float) -> Float:
    angles, count = t[:, None] * shape, len(shape)
    return np.asarray(t[:, None] * (amplitudes[count:] * np.cos(angles) - amplitudes[:count] * np.sin(angles)))


def _bells(t: Float, shape: Float) -> Float:
    off = np.clip((t[:, None] - shape[0::2]) * shape[1::2], -FLAT, FLAT)
    return np.asarray(np.exp(-(off**2)))


def _bell_slopes(t: Float, shape: Float, amplitudes: Float) -> Float:
    off, narrow = t[:, None] - shape[0::2], shape[1::2]
    off = np.where(np.abs(off * narrow) < FLAT, off, 0.0)  # no slope where it is flat: else steps grow without end
    heights = 2 * amplitudes * _bells(t, shape) * off * narrow
    slopes = np.empty((len(t), len(shape)))
    slopes[:, 0::2] = heights * narrow
    slopes[:, 1::2] = -heights * off
    return slopes


_HARMONICS = _Family(_harmonics, _harmonic_slopes)
_WAVES = _Family(_waves, _wave_slopes)
_BELLS = _Family(_bells, _bell_slopes)


def _grown(family: _Family, t: Float, power: Float, candidates: list[Float]) -> Float:
    """Adds the candidate that explains most of what is left, term by term, and brings all terms down each time."""
    shape, left = candidates[0][:0], power
    for _ in range(TERMS):
        more = min(candidates, key=partial(_left, family, t, left))
        shape = _brought_down(family, t, power, np.concatenate([shape, more]))
        left = power - _projected(family, t, power, shape)
    return shape


def _best(family: _Family, t: Float, power: Float, starts: list[Float]) -> Float:
    """The fit from the start that ends best."""
    ends = [_brought_down(family, t, power, start) for start in starts]
    return _projected(family, t, power, min(ends, key=partial(_left, family, t, power)))


def _brought_down(family: _Family, t: Float, power: Float, start: Float) -> Float:
    """The shape of least squares near ``start``; amplitudes are solved for each shape.

    Variable projection with Kaufman's Jacobian: what the slopes have within the columns is left out.
    """
    from scipy.optimize import least_squares

    def residual(shape: Float) -> Float:
        return _projected(family, t, power, shape) - power

    def jacobian(shape: Float) -> Float:
        columns = family.columns(t, shape)
        basis, _ = np.linalg.qr(columns)
        amplitudes = np.asarray(np.linalg.lstsq(columns, power, rcond=None)[0], dtype=np.float64)
        slopes = family.slopes(t, shape, amplitudes)
        return np.asarray(slopes - basis @ (basis.T @ slopes), dtype=np.float64)

    found = least_squares(residual, start, jac=jacobian, x_scale="jac", max_nfev=STEPS)
    return np.asarray(found.x, dtype=np.float64)


def _left(family: _Family, t: Float, power: Float, shape: Float) -> float:
    return float(np.sum((_projected(family, t, power, shape) - power) ** 2))


def _projected(family: _Family, t: Float, power: Float, shape: Float) -> Float:
    """The columns' least squares fit to the pattern."""
    basis, _ = np.linalg.qr(family.columns(t, shape))
    return np.asarray(basis @ (basis.T @ power), dtype=np.float64)
