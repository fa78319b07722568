"""Relaxed vector fitting: fits a rational function to samples on the imaginary axis.

Gustavsen and Semlyen, "Rational approximation of frequency domain responses by vector fitting" (IEEE Trans. Power
Delivery 14, 1999; [27] of Sabry et al.), with the relaxed scaling of Gustavsen, "Improving the pole relocating
properties of vector fitting" (IEEE Trans. Power Delivery 21, 2006).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float

Complex = NDArray[np.complex128]

REAL = 1e-9
"""A pole is real if its imaginary part is smaller than this share of its modulus."""
LEAST_SCALE = 1e-8
"""Smallest absolute constant of the scaling function; nearer 0 its zeros would diverge (2006, section IV)."""


@dataclass(frozen=True, slots=True)
class Rational:
    """f(s) = sum of r_k / (s - p_k), plus K.

    ``poles`` and ``residues`` (N,) contain both members of each conjugate pair; ``constant`` is real.
    """

    poles: Complex
    residues: Complex
    constant: float

    def at(self, s: Complex) -> Complex:
        """f (n,) at s (n,)."""
        parts = self.residues / (s[:, None] - self.poles)
        return np.asarray(parts.sum(axis=1) + self.constant, dtype=np.complex128)


def starting_poles(length: float, order: int) -> Complex:
    """``order`` / 2 poles in the upper half plane, evenly over 0 … ``length`` j, half a spacing left of that axis."""
    spacing = length / (order // 2)
    return np.asarray(spacing * (-0.5 + 1j * (np.arange(order // 2) + 0.5)), dtype=np.complex128)


def iterations(s: Complex, f: Complex, poles: Complex) -> Iterator[Rational]:
    """Yield the fit to f (n,) at s (n,) after each relocation of the poles, without end.

    ``poles`` are the starting poles: one of each conjugate pair (imaginary part > 0), and real ones; all stable.
    """
    while True:
        poles = _relocated(s, f, poles)
        yield _fitted(s, f, poles)


def _basis(s: Complex, poles: Complex) -> Complex:
    """Columns (n, N + 1) whose real combinations are all functions with these poles, and a constant (1999, (A.6))."""
    columns = []
    for pole in poles.tolist():
        first = 1 / (s - pole)
        if pole.imag == 0:
            columns.append(first)
        else:
            second = 1 / (s - pole.conjugate())
            columns += [first + second, 1j * (first - second)]
    return np.stack([*columns, np.ones_like(s)], axis=1)


def _relocated(s: Complex, f: Complex, poles: Complex) -> Complex:
    """Zeros of the scaling function sigma that makes sigma f rational with ``poles``: the poles of f, made stable."""
    columns = _basis(s, poles)
    width = columns.shape[1]
    both = np.hstack([columns, -f[:, None] * columns])
    triangle: Float = np.asarray(np.linalg.qr(np.vstack([both.real, both.imag]), mode="r"))
    # Only the rows of sigma in the joint least squares matter; the mean of its real part is fixed at 1 (2006, (8)).
    weight = float(np.linalg.norm(f)) / len(s)
    rows = np.vstack([triangle[width:, width:], weight * columns.real.sum(axis=0)])
    wanted = np.zeros(len(rows))
    wanted[-1] = weight * len(s)
    sigma = _solved(rows, wanted)
    scale = sigma[-1]
    if abs(scale) < LEAST_SCALE:
        scale = LEAST_SCALE if scale >= 0 else -LEAST_SCALE
    matrix, inputs = _realisation(poles)
    return _stable(np.asarray(np.linalg.eigvals(matrix - np.outer(inputs, sigma[:-1]) / scale), dtype=np.complex128))


def _fitted(s: Complex, f: Complex, poles: Complex) -> Rational:
    """Residues and constant that fit f best with fixed poles."""
    columns = _basis(s, poles)
    found = _solved(np.vstack([columns.real, columns.imag]), np.concatenate([f.real, f.imag]))
    all_poles: list[complex] = []
    residues: list[complex] = []
    at = 0
    for pole in poles.tolist():
        size = 1 if pole.imag == 0 else 2
        residue = complex(*found[at : at + size])
        all_poles += [pole, pole.conjugate()][:size]
        residues += [residue, residue.conjugate()][:size]
        at += size
    return Rational(np.array(all_poles), np.array(residues), float(found[-1]))


def _solved(rows: Float, wanted: Float) -> Float:
    """Least squares with normalised columns, so that narrow and wide poles have equal weight."""
    length = np.linalg.norm(rows, axis=0)
    found = np.linalg.lstsq(rows / length, wanted, rcond=None)[0]
    return np.asarray(found / length, dtype=np.float64)


def _realisation(poles: Complex) -> tuple[Float, Float]:
    """Real state matrix (N, N) and inputs (N,) of the functions in ``_basis`` (1999, appendix B)."""
    sizes = [1 if pole.imag == 0 else 2 for pole in poles.tolist()]
    matrix, inputs = np.zeros((sum(sizes), sum(sizes))), np.zeros(sum(sizes))
    at = 0
    for pole, size in zip(poles.tolist(), sizes, strict=True):
        block = [[pole.real, pole.imag], [-pole.imag, pole.real]]
        matrix[at : at + size, at : at + size] = np.asarray(block)[:size, :size]
        inputs[at] = size
        at += size
    return matrix, inputs


def _stable(zeros: Complex) -> Complex:
    """One of each conjugate pair, mirrored into the left half plane, by rising imaginary part."""
    stable = np.where(zeros.real > 0, -zeros.conj(), zeros)
    small = np.abs(stable.imag) <= REAL * np.abs(stable)
    stable = np.where(small, stable.real, stable)
    upper = stable[stable.imag >= 0]
    return np.asarray(upper[np.argsort(upper.imag, kind="stable")], dtype=np.complex128)
