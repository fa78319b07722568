"""Formats energies and powers in any unit with the same absolute precision."""

from __future__ import annotations

from math import ceil, log10

from cellwatt.report.numbers import fixed
from cellwatt.units import Unit


def amount(value: float, unit: Unit, digits: int = 1) -> str:
    """A value in J or W printed in ``unit``, with the precision of ``digits`` decimals of a J or W."""
    return fixed(float(unit.of(value)), digits + ceil(log10(unit.factor)))


def unsure(spread: float, unit: Unit) -> str:
    """An uncertainty in J or W printed in ``unit``; a positive one is shown as 0.01 J or W at least."""
    return amount(max(spread, 0.01) if spread > 0 else 0.0, unit, 1 if spread >= 1 else 2 if spread > 0 else 0)
