"""Criteria of a deviating cycle: equations (16) and (20) of Sabry et al."""

from __future__ import annotations

import math
from itertools import groupby

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cellwatt.arrays import Float
from cellwatt.quantity import Fraction, Radians, Watts
from cellwatt.section import Section

Codes = NDArray[np.int8]


class Tolerance(Section):
    """Largest distance from the reference that counts as healthy."""

    position: Radians = Field(default=math.radians(1.0), gt=0)
    """Encoder position."""
    power: Fraction = Field(default=0.10, gt=0)
    """Power, relative to the reference …"""
    floor: Watts = Field(default=5.0, ge=0)
    """… but never less than this."""

    def watts(self, reference: Float) -> Float:
        """Power tolerance epsilon_p of equation (16), W, for reference powers (n,) W ("±10 %", section V.D)."""
        return np.maximum(self.power * np.abs(reference), self.floor)


def ternary(residual: Float, limit: Float | float) -> Codes:
    """Equation (20): 0 where |r| <= eps, 1 where r > eps, -1 where r < -eps (the paper omits this minus sign)."""
    return np.where(residual > limit, 1, np.where(residual < -np.asarray(limit), -1, 0)).astype(np.int8)


def sustained(codes: Codes, frames: int) -> int:
    """The first nonzero code that lasts for ``frames`` consecutive frames, or 0: a single frame proves nothing."""
    return next((code for code, run in groupby(codes.tolist()) if code and sum(1 for _ in run) >= frames), 0)
