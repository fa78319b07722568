"""What an entry of the table of effects is, and how one is registered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from concealed.arms import Array
from concealed.setting import RATIO, Setting

Truth = dict[str, Any]
Draw = Callable[[Setting, int], Truth]
"""Puts the effect into the setting at a joint, in place; returns the true parameters as a key states them."""
Joints = Callable[[int], Sequence[int]]
"""The joints that can have the effect, of an arm with so many."""


@dataclass(frozen=True)
class Kind:
    """One entry; without `joints` it concerns the whole robot or its supply; `run_set` shows it."""

    name: str
    draw: Draw
    joints: Joints | None
    run_set: str = "short"


def into(table: dict[str, Kind], joints: Joints | None, run_set: str = "short") -> Callable[[Draw], Draw]:
    """Register a drawing function in a table under its own name."""

    def register(draw: Draw) -> Draw:
        table[draw.__name__] = Kind(draw.__name__, draw, joints, run_set)
        return draw

    return register


def every(n: int) -> Sequence[int]:
    """All joints."""
    return range(n)


def by_level(s: Setting, weak: float, medium: float, strong: float, most: float) -> float:
    """A size between the bounds of the setting's level; for effects whose noise ratio says little."""
    bounds = [weak, medium, strong, most]
    k = list(RATIO).index(s.level)
    return float(s.rng.uniform(bounds[k], bounds[k + 1]))


def either(s: Setting) -> float:
    """+1 or -1."""
    return float(s.rng.choice([-1.0, 1.0]))


def without(values: Array, joint: int) -> Array:
    """The values with zero at one joint."""
    out = values.copy()
    out[joint] = 0.0
    return out
