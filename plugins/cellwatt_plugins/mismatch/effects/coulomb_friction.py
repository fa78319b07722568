"""Coulomb friction that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping

from cellwatt_plugins.mismatch.effects.declaration import Confusion, Form, Relations
from cellwatt_plugins.mismatch.effects.effect import Effect, Estimate, Float, Parameter, Shape, said
from cellwatt_plugins.mismatch.effects.states import States
from cellwatt_plugins.robot.description import RobotDescription


class CoulombFriction(Effect):
    """Fc sign(w): absent from the description, or well off there."""

    name = "coulomb_friction"
    nominal = "coulomb_friction"
    relations = Relations(plainer=5.0)
    form = Form(reverses=True)
    confusions = (
        Confusion("viscous_friction", "sweep one joint at six constant speeds over two decades, both directions"),
    )

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.sign[:, joint][:, None]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"force": estimate.coefficient(0, "N*m")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"{who} needs {said(parameters['force'])} against its direction of motion: Coulomb friction is missing."
