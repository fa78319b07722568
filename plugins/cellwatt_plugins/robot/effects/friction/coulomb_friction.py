"""Coulomb friction that the simulation leaves out."""

from __future__ import annotations

from typing import Any

from cellwatt_plugins.robot.effects.declaration import Confusion, Form, Relations
from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.friction import Friction, Sliding


class CoulombFriction(Friction):
    """Fc sign(w): absent from the description, or with a clearly wrong value."""

    name = "coulomb_friction"
    nominal = "coulomb_friction"
    relations = Relations(plainer=5.0)
    form = Form(reverses=True)
    split = 10.0, ()
    confusions = (
        Confusion("viscous_friction", "sweep one joint at six constant speeds over two decades, both directions"),
    )
    coefficients_are = (("force", "N*m"),)
    sentence = "{who} needs {force} against its direction of motion: Coulomb friction is missing."

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        return sliding.sign
