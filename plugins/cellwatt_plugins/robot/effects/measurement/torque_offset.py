"""Measured torque wrong by a constant."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States


class TorqueOffset(Effect):
    """A constant, which is also there at rest."""

    name = "torque_offset"
    acceptance = Acceptance(usual=True)
    acts_on = "reading"
    confusions = (
        Confusion("asymmetric_friction", "hold the arm still: an offset stays, friction goes"),
        Confusion("spring_load", "hold the joint at several positions"),
    )
    coefficients_are = (("offset", "N*m"),)
    sentence = "The torque measured at {joint} is off by {offset}, at rest too."

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return np.ones((len(run.time), 1))
