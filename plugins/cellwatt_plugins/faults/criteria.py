"""Criteria of a deviating cycle: (16) and (20) of Sabry et al., and the rules under (16)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from cellwatt.arrays import Float
from cellwatt.quantity import Fraction, Radians, Watts

Codes = NDArray[np.int8]

Verdict = Literal["healthy", "encoder_fault", "joint_fault", "joint_and_encoder_fault"]


class Tolerance(BaseModel):
    """Distance from the healthy reference that is still healthy."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    position: Radians = Field(default=math.radians(1.0), gt=0)
    """Encoder position."""
    power: Fraction = Field(default=0.10, gt=0)
    """Power, relative to the reference …"""
    floor: Watts = Field(default=5.0, ge=0)
    """… but at least this."""

    def watts(self, reference: Float) -> Float:
        """epsilon_p of equation (16), W, for reference powers (n,) W ("±10 % over the reference", section V.D)."""
        return np.maximum(self.power * np.abs(reference), self.floor)


def verdict(*, position_outside: bool, power_outside: bool) -> Verdict:
    """The rules under equation (16) for one joint.

    Position outside with power inside: the encoder. Both outside: the joint and possibly its encoder too.
    Power outside alone: the joint, whose position loop still holds the path.
    """
    if position_outside:
        return "joint_and_encoder_fault" if power_outside else "encoder_fault"
    return "joint_fault" if power_outside else "healthy"


def ternary(residual: Float, limit: Float | float) -> Codes:
    """Equation (20): 0 where |r| <= eps, 1 where r > eps, -1 where r < -eps (the print lacks that minus)."""
    return np.where(residual > limit, 1, np.where(residual < -np.asarray(limit), -1, 0)).astype(np.int8)


def outside(value: Float, low: Float, high: Float) -> Float:
    """Signed distance of values to the band low … high; 0 within."""
    return value - np.clip(value, low, high)


def sustained(codes: Codes, frames: int) -> int:
    """The code that holds for ``frames`` neighbours in a row first, 0 if none does: one frame alone proves nothing."""
    return next((code for code, length in _runs(codes) if length >= frames), 0)


def longest(codes: Codes) -> int:
    """Length of the longest run of one nonzero code."""
    return max((length for _, length in _runs(codes)), default=0)


def _runs(codes: Codes) -> Iterator[tuple[int, int]]:
    """Each nonzero code with how many neighbours in a row have it."""
    return ((code, sum(1 for _ in run)) for code, run in groupby(codes.tolist()) if code)
