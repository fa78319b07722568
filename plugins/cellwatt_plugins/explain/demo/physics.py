"""The physics that can be concealed: its names, its random draw and the right answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cellwatt_plugins.explain.demo.arm import JOINTS, Arm

HEAVY: Final = (1, 2)
"""Joints (0-based) that carry weight."""
DRAWS: Final = 20
"""Draws of a kind, of which the first at a free joint is taken."""


@dataclass(frozen=True)
class Concealed:
    """One piece of physics that the arm has and the user's simulation does not."""

    kind: str
    effect: str
    """Name of the effect in ``explain``, or of the number if the simulation has that number."""
    joint: int | None
    """0-based; None for the whole arm."""
    numbers: Mapping[str, tuple[float, str]]
    """Parameters by the names that ``explain`` gives them, with their units."""
    sentence: str
    hidden: Mapping[str, float] = field(default_factory=dict)
    """Further numbers that the plant needs."""


Draw = Callable[[np.random.Generator, Arm], Concealed]


def kinds() -> list[str]:
    """Names of the physics that can be concealed."""
    return list(_DRAWN)


def by_chance(rng: np.random.Generator) -> list[str]:
    """Draw one kind, or two."""
    count = int(rng.choice([1, 2], p=[0.6, 0.4]))
    return [str(name) for name in rng.choice(kinds(), size=count, replace=False)]


def conceal(names: Sequence[str], rng: np.random.Generator, arm: Arm) -> list[Concealed]:
    """Draw joint and size of each kind; no joint gets two kinds if there are enough joints."""
    out: list[Concealed] = []
    for name in names:
        taken = {each.joint for each in out if each.joint is not None}
        drawn = [_DRAWN[name](rng, arm) for _ in range(DRAWS)]
        out.append(next((each for each in drawn if each.joint not in taken), drawn[0]))
    return out


def _friction(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    more = float(arm.frictionloss[joint] * rng.uniform(0.6, 1.2))
    now = float(arm.frictionloss[joint] + more)
    text = f"Joint {joint + 1} has {more:.2f} Nm more Coulomb friction"
    return Concealed("friction", "coulomb_friction", joint, {"now": (now, "N*m")}, text, {"more": more})


def _stribeck(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    excess, velocity = float(arm.frictionloss[joint] * rng.uniform(0.6, 1.2)), float(rng.uniform(0.05, 0.15))
    text = f"Joint {joint + 1} has {excess:.2f} Nm more friction below about {velocity:.2f} rad/s"
    numbers = {"excess": (excess, "N*m"), "velocity": (velocity, "rad/s")}
    return Concealed("stribeck", "stribeck_friction", joint, numbers, text)


def _payload(rng: np.random.Generator, arm: Arm) -> Concealed:
    mass, reach, aside = float(rng.uniform(1.0, 3.0)), float(rng.uniform(0.05, 0.15)), float(rng.uniform(0.04, 0.09))
    text = f"The flange carries {mass:.2f} kg, {1000 * aside:.0f} mm beside the last joint's axis"
    return Concealed("payload", "payload", None, {"mass": (mass, "kg")}, text, {"reach": reach, "aside": aside})


def _spring(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    stiffness, rest = float(np.array([12, 16, 10, 4])[joint] * rng.uniform(0.6, 1.4)), float(rng.uniform(-0.4, 0.4))
    text = f"A spring of {stiffness:.1f} Nm/rad pulls joint {joint + 1} towards {rest:.2f} rad"
    numbers = {"stiffness": (stiffness, "N*m/rad"), "rest": (rest, "rad")}
    return Concealed("spring", "spring_load", joint, numbers, text)


def _gain(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint, gain = int(rng.choice(HEAVY)), float(rng.uniform(0.08, 0.18) * rng.choice([-1, 1]))
    way = "high" if gain > 0 else "low"
    text = f"The torque measured at joint {joint + 1} reads {100 * abs(gain):.1f} % {way}"
    return Concealed("gain", "torque_gain", joint, {"gain": (gain, "")}, text)


def _offset(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    size = float(arm.frictionloss[joint] * rng.uniform(0.3, 0.8) * rng.choice([-1, 1]))
    text = f"The torque measured at joint {joint + 1} is off by {size:.2f} Nm"
    return Concealed("offset", "torque_offset", joint, {"offset": (size, "N*m")}, text)


def _delay(rng: np.random.Generator, arm: Arm) -> Concealed:
    delay = float(rng.uniform(0.008, 0.025))
    text = f"The torque channels run {1000 * delay:.1f} ms behind the positions"
    return Concealed("delay", "time_delay", None, {"delay": (delay, "s")}, text)


def _any(rng: np.random.Generator) -> int:
    return int(rng.integers(JOINTS))


_DRAWN: Final[Mapping[str, Draw]] = {
    "friction": _friction,
    "stribeck": _stribeck,
    "payload": _payload,
    "spring": _spring,
    "gain": _gain,
    "offset": _offset,
    "delay": _delay,
}
