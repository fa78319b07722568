"""Reflected rotor inertia that the simulation leaves out."""

from __future__ import annotations

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States


class RotorInertia(Effect):
    """I qdd: absent from the description, or with a clearly wrong value."""

    name = "rotor_inertia"
    of_motor = True
    nominal = "rotor_inertia"
    confusions = (
        Confusion("link_inertial_error", "move the joint in several poses of the others: a rotor adds the same in all"),
        Confusion("time_delay", "run the same path at two speeds"),
    )
    coefficients_are = (("inertia", "kg*m^2"),)
    sentence = "{who} needs {inertia} more to speed up: the rotor's inertia is missing."

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.qdd[:, joint][:, None]
