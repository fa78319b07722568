"""Friction that grows with the load on the gear."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Uncertainty
from cellwatt_plugins.robot.effects.effect import Parameter, Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding


class LoadDependentFriction(Friction):
    """c · |load torque| · sign(w); the load is what the links need."""

    name = "load_dependent_friction"
    acts_on = "friction"
    depends_on = "load"
    acceptance = Acceptance(above=0.0)
    uncertainty = Uncertainty({"coefficient": 0.015})
    """The coefficient is a share of the load, which is as uncertain as the links."""
    plausible = (lambda c: float(c[0])), 0.0, 0.6
    """A gear with more friction under load would not turn backwards."""
    trained = MappingProxyType({"friction by load": ()})
    doubt = 0.1, ()
    confusions = (
        Confusion("torque_gain", "hold the arm still at several loads: friction then has no direction, a gain stays"),
        Confusion("asymmetric_friction", "sweep where gravity does not load the joint"),
    )
    coefficients_are = (("coefficient", ""),)

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        return np.abs(sliding.load) * sliding.sign

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        share = 100 * parameters["coefficient"].value
        return f"{who} loses {share:.1f} % of its load torque to friction: load-dependent friction is missing."
