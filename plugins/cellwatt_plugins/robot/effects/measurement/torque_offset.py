"""Measured torque off by a constant."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cellwatt.batch import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape, said
from cellwatt_plugins.robot.effects.states import States


class TorqueOffset(Effect):
    """A constant, at rest too."""

    name = "torque_offset"
    acceptance = Acceptance(usual=True)
    acts_on = "reading"
    confusions = (
        Confusion("asymmetric_friction", "hold the arm still: an offset stays, friction goes"),
        Confusion("spring_load", "hold the joint at several positions"),
    )

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return np.ones((len(run.time), 1))

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"offset": estimate.coefficient(0, "N*m")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"The torque measured at {who.lower()} is off by {said(parameters['offset'])}, at rest too."
