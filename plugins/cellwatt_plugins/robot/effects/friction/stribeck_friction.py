"""Stribeck friction: more at low speed."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form, Relations
from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding
from cellwatt_plugins.robot.effects.states import States

FASTEST = 0.5
"""Greatest ws in rad/s: a slower decay is nonlinear viscous friction, not boundary lubrication of a gear."""
SPEEDS = np.geomspace(0.008, 0.4, 12)
"""Velocities ws in rad/s that are tried."""
LORENTZ = 1.0
FASTEST_LORENTZ = 0.2
"""Greatest ws in rad/s of the form that decays slowly."""
TRAINED = (0.03, 0.06, 0.1, 0.16, 0.25)
"""Velocities ws in rad/s that a power model is trained with."""


class StribeckFriction(Friction):
    """excess · exp(-(w/ws)²) sign(w) on top of Coulomb and viscous friction: shape (ws,).

    Or excess / (1 + (w/ws)²) sign(w), which falls off more slowly (Hess and Soom): shape (ws, 1).
    """

    name = "stribeck_friction"
    acts_on = "friction"
    relations = Relations(along="velocity", beats=("coulomb_friction",))
    form = Form(reverses=True)
    acceptance = Acceptance(above=0.0, inside_bounds=True)
    trained = MappingProxyType({f"Stribeck friction ({speed} rad/s)": (speed,) for speed in TRAINED})
    doubt = 0.2, (0.08,)
    confusions = (
        Confusion("presliding_hysteresis", "reverse slowly at one place: presliding depends on the way since reversal"),
        Confusion("load_dependent_friction", "sweep slowly at two loads: Stribeck friction does not change with load"),
    )
    coefficients_are = (("excess", "N*m"),)
    shape_is = (("velocity", "rad/s"),)
    sentence = (
        "{who} needs {excess} more below about {velocity:.2g} rad/s than "
        "Coulomb and viscous friction give: Stribeck friction is missing."
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        fastest = max(float(np.max(np.abs(run.qd[:, joint]))) for run in runs)
        seen = [float(speed) for speed in SPEEDS if speed < 0.6 * fastest]
        return [*((speed,) for speed in seen), *((speed, LORENTZ) for speed in seen if speed < FASTEST_LORENTZ)]

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        share = sliding.qd / shape[0]
        decay = 1 / (1 + share * share) if len(shape) > 1 else np.exp(-(share * share))
        return sliding.sign * decay

    def shown(self, shape: Shape, slowest: float, fastest: float) -> bool:
        return slowest < shape[0] < fastest

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.006, FASTEST)] if len(shape) == 1 else [(0.006, FASTEST_LORENTZ), (LORENTZ, LORENTZ)]
