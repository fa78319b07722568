"""The physics that can be concealed: what it is called, how it is drawn, and what the right answer is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cellwatt_plugins.mismatch.demo.arm import JOINTS, Arm

KINDS: Final = ("friction", "stribeck", "payload", "spring")
STIFFNESS: Final = (12.0, 16.0, 10.0, 4.0)
"""Nm/rad of a spring at each joint, about."""


@dataclass(frozen=True)
class Concealed:
    """One piece of physics that the arm has and the user's simulation does not."""

    kind: str
    effect: str
    """Name that ``explain`` has for it; of a number that the simulation has, the number's."""
    joint: int | None
    """0-based; None for the whole arm."""
    numbers: Mapping[str, tuple[float, str]]
    """Parameters by the names that ``explain`` gives them, with their units."""
    sentence: str
    hidden: Mapping[str, float] = field(default_factory=dict)
    """What the plant needs beyond that."""


def by_chance(rng: np.random.Generator) -> list[str]:
    """One kind, or two."""
    count = int(rng.choice([1, 2], p=[0.6, 0.4]))
    return [str(name) for name in rng.choice(KINDS, size=count, replace=False)]


def conceal(names: Sequence[str], rng: np.random.Generator, arm: Arm) -> list[Concealed]:
    """Draw the size of each of some different kinds, no two at one joint."""
    places = rng.permutation(JOINTS).tolist()
    return [_drawn(name, joint, rng, arm) for name, joint in zip(names, places, strict=False)]


def _drawn(kind: str, joint: int, rng: np.random.Generator, arm: Arm) -> Concealed:
    dry = float(arm.frictionloss[joint])
    more = dry * float(rng.uniform(0.6, 1.2))
    if kind == "friction":
        text = f"Joint {joint + 1} has {more:.2f} Nm more Coulomb friction"
        return Concealed(kind, "coulomb_friction", joint, {"now": (dry + more, "N*m")}, text, {"more": more})
    if kind == "stribeck":
        velocity = float(rng.uniform(0.05, 0.15))
        text = f"Joint {joint + 1} has {more:.2f} Nm more friction below about {velocity:.2f} rad/s"
        numbers = {"excess": (more, "N*m"), "velocity": (velocity, "rad/s")}
        return Concealed(kind, "stribeck_friction", joint, numbers, text)
    if kind == "spring":
        stiffness, rest = float(STIFFNESS[joint] * rng.uniform(0.6, 1.4)), float(rng.uniform(-0.4, 0.4))
        text = f"A spring of {stiffness:.1f} Nm/rad pulls joint {joint + 1} towards {rest:.2f} rad"
        numbers = {"stiffness": (stiffness, "N*m/rad"), "rest": (rest, "rad")}
        return Concealed(kind, "spring_load", joint, numbers, text)
    mass, reach, aside = float(rng.uniform(1.0, 3.0)), float(rng.uniform(0.05, 0.15)), float(rng.uniform(0.04, 0.09))
    text = f"The flange carries {mass:.2f} kg, {1000 * aside:.0f} mm beside the last joint's axis"
    return Concealed(kind, "payload", None, {"mass": (mass, "kg")}, text, {"reach": reach, "aside": aside})
