"""Coulomb friction that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Form, Relations
from cellwatt_plugins.robot.effects.effect import Estimate, Parameter, Shape, said
from cellwatt_plugins.robot.effects.friction import Friction, Sliding


class CoulombFriction(Friction):
    """Fc sign(w): absent from the description, or well off there."""

    name = "coulomb_friction"
    nominal = "coulomb_friction"
    relations = Relations(plainer=5.0)
    form = Form(reverses=True)
    split = 10.0, ()
    confusions = (
        Confusion("viscous_friction", "sweep one joint at six constant speeds over two decades, both directions"),
    )

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        return sliding.sign

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"force": estimate.coefficient(0, "N*m")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"{who} needs {said(parameters['force'])} against its direction of motion: Coulomb friction is missing."
