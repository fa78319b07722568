"""Constant supply power that the simulation leaves out."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Confusion, Relations, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States


class StandbyPower(Effect):
    """A constant: absent from the description, or with a clearly wrong value."""

    name = "standby_power"
    acts_on = "supply"
    nominal = "standby_power"
    relations = Relations(plainer=6.0)
    uncertainty = Uncertainty({"power": 0.002})
    """Measured at rest, where no other power is drawn."""
    confusions = (Confusion("brake_power", "record some minutes at rest, between two motions, with the brakes closed"),)
    coefficients_are = (("power", "W"),)
    sentence = "The supply draws {power} at all times: standby power is missing."

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return np.ones((len(run.time), 1))
