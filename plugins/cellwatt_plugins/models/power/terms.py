"""Terms of the torque and of the electrical power of a drive, as formulas for arrays and for model files.

``Motion`` holds arrays in training and tensors of a graph in a model file; numpy's ufuncs serve both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cellwatt_plugins.robot.effects import FRICTION
from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding


@dataclass(frozen=True)
class Motion:
    """State of the joints that terms of torque depend on, (N, n) each."""

    q: Any
    """rad."""
    qd: Any
    """rad/s."""
    qdd: Any
    """rad/s²."""
    load: Any
    """Torque of the rigid bodies, Nm."""
    sign: Any
    """tanh(q̇ / width): the direction, which reverses within ``width``."""
    warmth: Any = None
    """Joint temperature minus the training's mean, in 10 K."""


Formula = Callable[[Motion], Any]

LAWS: Final = {words: (law, shape) for law in FRICTION for words, shape in law.trained.items()}
"""Laws of friction that may be selected, by their name in the report, each with its shape."""


def _rubbing(law: Friction, shape: Shape) -> Formula:
    return lambda m: law.torque(Sliding(m.qd, m.sign, m.load), shape)


HARMONICS: Final = tuple(range(1, 13))
"""Periods per turn of torques that repeat with the angle."""


def _harmonic(wave: Callable[[Any], Any], n: int) -> Formula:
    return lambda m: wave(m.q * float(n))


TORQUE: Final[Mapping[str, Formula]] = {
    "rotor": lambda m: m.qdd,
    "coulomb": lambda m: m.sign,
    "viscous": lambda m: m.qd,
    **{words: _rubbing(*law) for words, law in LAWS.items()},
    "saturating": lambda m: np.tanh(m.qd / 0.5),
    "viscous load": lambda m: m.qd * np.abs(m.load),
    "gain": lambda m: m.load,
    "direction": lambda m: np.abs(m.sign),
    "viscous direction": lambda m: np.abs(m.qd),
    "offset": lambda m: 0.0 * m.q + 1.0,
    "spring": lambda m: m.q,
    **{f"sine {n}": _harmonic(np.sin, n) for n in HARMONICS},
    **{f"cosine {n}": _harmonic(np.cos, n) for n in HARMONICS},
    "warm coulomb": lambda m: m.sign * m.warmth,
    "warm viscous": lambda m: m.qd * m.warmth,
}
"""Torque of a joint beyond the rigid bodies', in Nm, each times a coefficient of the joint."""

ALWAYS: Final = ("gain", "rotor", "coulomb", "viscous")
"""Terms of every model. The first one is the deviation of a joint's torque constant, a share of its load."""
EFFECTS: Final[Mapping[str, tuple[str, ...]]] = {
    **{words: (words,) for words in LAWS},
    "viscous friction that saturates": ("saturating",),
    "viscous friction by load": ("viscous load",),
    "friction by direction": ("direction", "viscous direction"),
    "constant torque": ("offset",),
    "spring": ("offset", "spring"),
    **{f"torque by angle, {n} a turn": ("offset", f"sine {n}", f"cosine {n}") for n in HARMONICS},
    "friction by temperature": ("warm coulomb", "warm viscous"),
}
"""Effects that may be selected beside the terms of every model, and the terms of each."""
WARM: Final = "friction by temperature"


def terms_of(effects: Iterable[str]) -> tuple[str, ...]:
    """The terms of every model and those of ``effects``, each once."""
    return tuple(dict.fromkeys([*ALWAYS, *(term for effect in effects for term in EFFECTS[effect])]))


DRIVE_ALWAYS: Final = ("mechanical", "copper")
LOSSES: Final[Mapping[str, tuple[str, ...]]] = {
    "iron loss": ("hysteresis",),
    "eddy-current loss": ("eddy",),
    "loss of the inverters by current": ("switching",),
}
"""Losses that may be selected beside the terms of every model, and the terms of each."""
