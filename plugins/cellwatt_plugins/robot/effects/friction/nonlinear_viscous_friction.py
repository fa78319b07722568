"""Viscous friction that does not grow in proportion to speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Parameter, Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding

EXPONENTS = (0.3, 0.5, 0.7, 1.5, 2.0, 2.5, 3.0)


class NonlinearViscousFriction(Friction):
    """c · |w|^a sign(w) with a other than 1."""

    name = "nonlinear_viscous_friction"
    acts_on = "friction"
    relations = Relations(
        along="velocity", lessens=("viscous_friction",), beats=("viscous_friction", "coulomb_friction")
    )
    acceptance = Acceptance(inside_bounds=True)
    trained = MappingProxyType({"quadratic viscous friction": (2.0,), "cubic viscous friction": (3.0,)})
    split = 0.5, (2.0,)
    confusions = (
        Confusion("stribeck_friction", "sweep at six constant speeds over two decades, up to full speed"),
        Confusion("temperature_dependent_friction", "repeat the same cycle cold and warm"),
    )
    coefficients_are = (("coefficient", "N*m"),)
    shape_is = (("exponent", ""),)
    tried = tuple((a,) for a in EXPONENTS)

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        return np.abs(sliding.qd) ** shape[0] * sliding.sign

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.15, 0.85)] if shape[0] < 1 else [(1.2, 5.0)]

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        size, exponent = parameters["coefficient"].value, parameters["exponent"].value
        grows = "faster" if (exponent > 1) == (size > 0) else "slower"
        return (
            f"Friction of {who.lower()} grows {grows} than speed: a term {size:.3g} Nm · w^{exponent:.2f} is missing."
        )
