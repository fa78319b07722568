"""Equations (17) and (18) of the paper as printed, which are not the curve of its Fig. 10."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.paper.rational import Rational

Float = NDArray[np.float64]


def power_17(response: Rational, t: Float) -> Float:
    """Eq. (17), (n,) W at t (n,) s: the sum of the moduli of all terms."""
    distance = np.hypot(t[:, None] - response.poles.imag, response.poles.real)
    return np.asarray((np.abs(response.residues) / distance).sum(axis=1) + abs(response.constant))


def phase_18(response: Rational, t: Float) -> Float:
    """Eq. (18), (n,) rad at t (n,) s: angles of the residues less those of the distances to the poles."""
    r, p = response.residues, response.poles
    with np.errstate(divide="ignore"):  # a residue without a real part turns by a quarter
        own = np.arctan(r.imag / r.real)
    turned = np.arctan((t[:, None] - p.imag) / -p.real)
    return np.asarray((own - turned).sum(axis=1) + np.arctan(response.constant))
