"""Reflected rotor inertia that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping

from cellwatt.batch import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape, said
from cellwatt_plugins.robot.effects.states import States


class RotorInertia(Effect):
    """I qdd: absent from the description, or well off there."""

    name = "rotor_inertia"
    nominal = "rotor_inertia"
    confusions = (
        Confusion("link_inertial_error", "move the joint in several poses of the rest: a rotor feels the same in all"),
        Confusion("time_delay", "run the same path at two speeds"),
    )

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.qdd[:, joint][:, None]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"inertia": estimate.coefficient(0, "kg*m^2")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"{who} needs {said(parameters['inertia'])} more to speed up: the rotor's inertia is missing."
