"""Physical limits of effects: beyond them, a form stands for something else and is not named."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cellwatt.batch import Float

POSSIBLE: Mapping[str, tuple[Callable[[Float], float], float, float]] = {
    # A load whose centre is more than a metre from the flange is an error of the links.
    "payload": (lambda c: float(np.linalg.norm(c[1:4]) / c[0]) if c[0] > 0 else np.inf, 0.0, 1.0),
    # A torque constant that is more than a third off is another drive's or unit's.
    "torque_gain": (lambda c: float(c[0]), -0.35, 0.35),
    # A base that leans by more than 10 degrees is meant to: it is a mount.
    "gravity_tilt": (lambda c: float(np.hypot(c[0], c[1])), 0.0, 0.18),
    # A hose or balancer rests within a turn of where the joint goes.
    "spring_load": (lambda c: float(-c[1] / c[0]) if c[0] else np.inf, -3 * np.pi, 3 * np.pi),
    # A gear that loses more than this under load would not turn back.
    "load_dependent_friction": (lambda c: float(c[0]), 0.0, 0.6),
    # No more can be lost than the braking drives give back.
    "regeneration_dissipated": (lambda c: float(c[0]), 0.0, 1.2),
    # A converter that passes on less than 40 % would burn.
    "converter_efficiency": (lambda c: float(c[0]), 0.0, 1.5),
}
"""Of effects that could otherwise stand for anything, a number of the coefficients (m,), and the range it can have."""


def plausible(effect: str, coefficients: Float) -> bool:
    """True if coefficients (m,) of an effect can be."""
    if effect not in POSSIBLE:
        return True
    number, low, high = POSSIBLE[effect]
    return low <= number(coefficients) <= high
