"""Guesses the quantities of columns with unknown names from their values."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.tables.names import understood, usual
from cellwatt.tables.table import Table

ALIKE: Final = 0.9
"""Smallest correlation of a velocity with the derivative of its position."""
FOLLOWS: Final = 0.5
"""Smallest share of a torque's variance that the motion of the joints explains."""
MOST: Final = 20_000
"""Largest number of rows that are used."""
_NUMBERED: Final = re.compile(r"(?P<before>.*?\D)(?P<number>\d+)(?P<after>\D*)")


@dataclass(frozen=True)
class Likely:
    """Columns that look like a quantity of all joints; ``pattern`` is their name with ``{}`` for the number."""

    quantity: str
    pattern: str
    names: tuple[str, ...]

    def __str__(self) -> str:
        stem = usual(self.quantity)
        return (
            f"{self.names[0]} … {self.names[-1]} look like the {self.quantity} of joints 1 to {len(self.names)}: "
            f"pass --columns {shlex.quote(f'{stem}={self.pattern}')}"
        )


def likely(table: Table) -> list[Likely]:
    """Guesses for columns with unknown names: positions with their velocities, and torques explained by them."""
    rows = slice(0, MOST)
    time, unknown = table.time[rows], dict(_families(table))
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        return []  # no derivatives
    values = {pattern: np.column_stack([table.columns[n][rows] for n in names]) for pattern, names in unknown.items()}
    found: dict[str, str] = {}
    known = table.joints("position")
    position = None if known is None else known[rows]
    pairs = [(a, b) for a in values for b in values if a != b] if position is None else [("", b) for b in values]
    for a, b in pairs:
        q = values[a] if a else position
        if q is not None and q.shape == values[b].shape and _is_slope(time, q, values[b]):
            found |= {a: "position", b: "velocity"} if a else {b: "velocity"}
            position = q
            break
    if position is not None and table.joints("torque") is None:
        remainder = {p: v for p, v in values.items() if p not in found and v.shape == position.shape}
        shares = {p: _share(time, position, v) for p, v in remainder.items()}
        best = max(shares, key=lambda p: shares[p], default=None)
        if best is not None and shares[best] > FOLLOWS:
            found[best] = "torque"
    return [Likely(quantity, pattern, unknown[pattern]) for pattern, quantity in found.items()]


def hint(table: Table) -> str:
    """The guesses as the end of a message, or else how to name columns that are numbered; empty without any."""
    known = "".join(f"; {each}" for each in likely(table))
    pattern = next((pattern for pattern, _ in _families(table)), None)
    named = f"; --columns names columns like {pattern}, as 'q [deg]={pattern}' or 'tau={pattern}'"
    return known or (named if pattern else "")


def _families(table: Table) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Numeric columns with unknown names that differ in one consecutive number, by their pattern."""
    by_pattern: dict[str, dict[int, str]] = {}
    for name in table.columns:
        match = _NUMBERED.fullmatch(name)
        unknown = understood(name) is None and name not in table.meant
        if match is not None and unknown and np.isfinite(table.columns[name]).all():
            by_pattern.setdefault(f"{match['before']}{{}}{match['after']}", {})[int(match["number"])] = name
    for pattern, numbered in by_pattern.items():
        numbers = sorted(numbered)
        if len(numbers) > 1 and numbers == list(range(numbers[0], numbers[-1] + 1)) and numbers[0] in (0, 1):
            yield pattern, tuple(numbered[number] for number in numbers)


def _is_slope(time: Float, position: Float, velocity: Float) -> bool:
    """True if ``velocity`` (N, n) is the derivative of ``position`` (N, n) for each joint that moves."""
    slope = np.gradient(position, time, axis=0)
    moving = np.std(slope, axis=0) > 1e-3
    pairs = [(slope[:, j], velocity[:, j]) for j in np.flatnonzero(moving)]
    return bool(pairs) and all(np.std(b) > 0 and np.corrcoef(a, b)[0, 1] > ALIKE for a, b in pairs)


def _share(time: Float, position: Float, values: Float) -> float:
    """Median share of the variance of ``values`` (N, n) that terms of gravity, friction and inertia explain."""
    qd = np.gradient(position, time, axis=0)
    sums = np.cumsum(position, axis=1)
    columns = [np.ones(len(time)), *qd.T, *np.tanh(qd / 0.02).T, *np.gradient(qd, time, axis=0).T]
    columns += [*np.sin(sums).T, *np.cos(sums).T, *np.sin(position).T, *np.cos(position).T]
    design = np.column_stack(columns)
    remainder = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    return float(np.median(1 - np.var(remainder, axis=0) / np.maximum(np.var(values, axis=0), 1e-12)))
