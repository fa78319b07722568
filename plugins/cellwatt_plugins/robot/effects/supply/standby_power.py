"""Constant supply power that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cellwatt.batch import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Relations, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape, said
from cellwatt_plugins.robot.effects.states import States


class StandbyPower(Effect):
    """A constant: absent from the description, or well off there."""

    name = "standby_power"
    acts_on = "supply"
    nominal = "standby_power"
    relations = Relations(plainer=6.0)
    uncertainty = Uncertainty({"power": 0.002})
    """Read at rest, where nothing else is drawn."""
    confusions = (Confusion("brake_power", "record some minutes at rest with the brakes closed"),)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return np.ones((len(run.time), 1))

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"power": estimate.coefficient(0, "W")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return f"The supply draws {said(parameters['power'])} at all times: standby power is missing."
