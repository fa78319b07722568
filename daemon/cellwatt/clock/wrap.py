"""Counters of a device that begin anew at the end of their range."""

from __future__ import annotations


def unwrapped(value: int, wrap: int, near: float) -> int:
    """Return the number that is ``value`` modulo ``wrap`` and nearest to ``near``."""
    return value + wrap * round((near - value) / wrap)
