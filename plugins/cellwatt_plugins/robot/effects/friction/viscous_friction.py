"""Viscous friction that the simulation leaves out."""

from __future__ import annotations

from typing import Any

from cellwatt_plugins.robot.effects.declaration import Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding


class ViscousFriction(Friction):
    """Fv w: absent from the description, or with a clearly wrong value."""

    name = "viscous_friction"
    nominal = "viscous_friction"
    relations = Relations(plainer=5.0, beats=("coulomb_friction",), upon=("coulomb_friction",))
    split = 10.0, ()
    confusions = (
        Confusion("coulomb_friction", "sweep one joint at six constant speeds over two decades, both directions"),
        Confusion("temperature_dependent_friction", "repeat the same cycle cold and warm"),
    )
    coefficients_are = (("coefficient", "N*m*s/rad"),)
    sentence = "{who} needs {coefficient} more with speed: viscous friction is missing."

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        return sliding.qd
