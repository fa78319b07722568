"""Physical limits of effects: beyond them, a form stands for something else and is not named."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cellwatt.batch import Float


@dataclass(frozen=True)
class Bound:
    """A number of an effect, the range that it can have, and why."""

    number: Callable[[Float], float]
    """Of its coefficients (m,)."""
    low: float
    high: float
    why: str


BOUNDS: Mapping[str, Bound] = {
    "payload": Bound(
        lambda c: float(np.linalg.norm(c[1:4]) / c[0]) if c[0] > 0 else np.inf,
        0.0,
        1.0,
        "a load whose centre is more than a metre from the flange is an error of the links",
    ),
    "torque_gain": Bound(
        lambda c: float(c[0]),
        -0.35,
        0.35,
        "a torque constant that is more than a third off is another drive's or unit's",
    ),
    "gravity_tilt": Bound(
        lambda c: float(np.hypot(c[0], c[1])),
        0.0,
        0.18,
        "a base that leans by more than 10 degrees is meant to: it is a mount",
    ),
    "spring_load": Bound(
        lambda c: float(-c[1] / c[0]) if c[0] else np.inf,
        -3 * np.pi,
        3 * np.pi,
        "a hose or balancer rests within a turn of where the joint goes",
    ),
    "load_dependent_friction": Bound(
        lambda c: float(c[0]), 0.0, 0.6, "a gear that loses more than this under load would not turn back"
    ),
    "regeneration_dissipated": Bound(
        lambda c: float(c[0]), 0.0, 1.2, "no more can be lost than the braking drives give back"
    ),
    "converter_efficiency": Bound(
        lambda c: float(c[0]), 0.0, 1.5, "a converter that passes on less than 40 % would burn"
    ),
}
"""One range for each effect that could otherwise stand for anything."""


def impossible(effect: str, coefficients: Float) -> str | None:
    """Why coefficients (m,) of an effect cannot be; None where they can."""
    bound = BOUNDS.get(effect)
    if bound is None:
        return None
    return None if bound.low <= bound.number(coefficients) <= bound.high else bound.why
