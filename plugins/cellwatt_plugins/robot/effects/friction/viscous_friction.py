"""Viscous friction that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Estimate, Parameter, Shape, said
from cellwatt_plugins.robot.effects.friction import Friction, Sliding


class ViscousFriction(Friction):
    """Fv w: absent from the description, or well off there."""

    name = "viscous_friction"
    nominal = "viscous_friction"
    relations = Relations(plainer=5.0, beats=("coulomb_friction",), upon=("coulomb_friction",))
    split = 10.0, ()
    confusions = (
        Confusion("coulomb_friction", "sweep one joint at six constant speeds over two decades, both directions"),
        Confusion("temperature_dependent_friction", "repeat the same cycle cold and warm"),
    )

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        return sliding.qd

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"coefficient": estimate.coefficient(0, "N*m*s/rad")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"{who} needs {said(parameters['coefficient'])} more with speed: viscous friction is missing."
