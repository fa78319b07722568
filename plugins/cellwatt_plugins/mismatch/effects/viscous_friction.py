"""Viscous friction that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping

from cellwatt_plugins.mismatch.effects.declaration import Confusion, Relations
from cellwatt_plugins.mismatch.effects.effect import Effect, Estimate, Float, Parameter, Shape, said
from cellwatt_plugins.mismatch.effects.states import States
from cellwatt_plugins.robot.description import RobotDescription


class ViscousFriction(Effect):
    """Fv w: absent from the description, or well off there."""

    name = "viscous_friction"
    nominal = "viscous_friction"
    relations = Relations(plainer=5.0)
    confusions = (
        Confusion("coulomb_friction", "sweep one joint at six constant speeds over two decades, both directions"),
        Confusion("temperature_dependent_friction", "repeat the same cycle cold and warm"),
    )

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.qd[:, joint][:, None]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"coefficient": estimate.coefficient(0, "N*m*s/rad")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"{who} needs {said(parameters['coefficient'])} more with speed: viscous friction is missing."
