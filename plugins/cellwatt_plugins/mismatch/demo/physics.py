"""The physics that can be concealed: what it is called, how it is drawn, and what the right answer is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from cellwatt_plugins.mismatch.demo.arm import JOINTS, Arm

HEAVY: Final = (1, 2)
"""Joints (0-based) that carry weight."""
DRAWS: Final = 20
"""Of a place, until one is free."""


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


Draw = Callable[[np.random.Generator, Arm], Concealed]


def kinds() -> list[str]:
    """What can be concealed."""
    return list(_DRAWN)


def by_chance(rng: np.random.Generator) -> list[str]:
    """One kind, or two."""
    count = int(rng.choice([1, 2], p=[0.6, 0.4]))
    return [str(name) for name in rng.choice(kinds(), size=count, replace=False)]


def conceal(names: Sequence[str], rng: np.random.Generator, arm: Arm) -> list[Concealed]:
    """Draw the place and size of each kind; no joint gets two where there are joints enough."""
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


def _damping(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    more = float(arm.damping[joint] * rng.uniform(0.6, 1.2))
    now = float(arm.damping[joint] + more)
    text = f"Joint {joint + 1} has {more:.2f} Nm s/rad more viscous friction"
    return Concealed("damping", "viscous_friction", joint, {"now": (now, "N*m*s/rad")}, text, {"more": more})


def _stribeck(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    excess, velocity = float(arm.frictionloss[joint] * rng.uniform(0.6, 1.2)), float(rng.uniform(0.05, 0.15))
    text = f"Joint {joint + 1} has {excess:.2f} Nm more friction below about {velocity:.2f} rad/s"
    numbers = {"excess": (excess, "N*m"), "velocity": (velocity, "rad/s")}
    return Concealed("stribeck", "stribeck_friction", joint, numbers, text)


def _load_friction(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint, share = int(rng.choice(HEAVY)), float(rng.uniform(0.08, 0.16))
    text = f"Joint {joint + 1} loses {100 * share:.1f} % of its load to friction"
    return Concealed("load-friction", "load_dependent_friction", joint, {"coefficient": (share, "")}, text)


def _one_way(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint = _any(rng)
    size = float(arm.frictionloss[joint] * rng.uniform(0.6, 1.2) * rng.choice([-1, 1]))
    way = "positive" if size > 0 else "negative"
    text = f"Joint {joint + 1} has {abs(size):.2f} Nm more friction in {way} direction than in the other"
    return Concealed("one-way-friction", "asymmetric_friction", joint, {"difference": (size, "N*m")}, text)


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


def _tilt(rng: np.random.Generator, arm: Arm) -> Concealed:
    roll, pitch = (float(x) for x in rng.uniform(0.02, 0.05, 2) * rng.choice([-1, 1], 2))
    text = f"The base leans {np.degrees(roll):.1f}° in roll and {np.degrees(pitch):.1f}° in pitch"
    return Concealed("tilt", "gravity_tilt", None, {"roll": (roll, "rad"), "pitch": (pitch, "rad")}, text)


def _ripple(rng: np.random.Generator, arm: Arm) -> Concealed:
    joint, cycles = _any(rng), int(rng.integers(8, 30))
    size, phase = float(arm.frictionloss[joint] * rng.uniform(0.25, 0.5)), float(rng.uniform(-3, 3))
    text = f"Joint {joint + 1} has a ripple of {size:.2f} Nm, {cycles} times a turn"
    numbers = {"amplitude": (size, "N*m"), "cycles": (float(cycles), "1/turn")}
    return Concealed("ripple", "position_periodic_torque", joint, numbers, text, {"phase": phase})


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
    "damping": _damping,
    "stribeck": _stribeck,
    "load-friction": _load_friction,
    "one-way-friction": _one_way,
    "payload": _payload,
    "spring": _spring,
    "tilt": _tilt,
    "ripple": _ripple,
    "gain": _gain,
    "offset": _offset,
    "delay": _delay,
}
