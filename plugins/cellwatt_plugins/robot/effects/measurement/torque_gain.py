"""Measured torque wrong by a factor."""

from __future__ import annotations

from collections.abc import Mapping

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States


class TorqueGain(Effect):
    """measured = (1 + gain) · true."""

    name = "torque_gain"
    acts_on = "reading"
    depends_on = "fitted torque"
    plausible = (lambda c: float(c[0])), -0.35, 0.35
    """A torque constant that is wrong by more than a third belongs to another drive or unit."""
    confusions = (
        Confusion(
            "link_inertial_error", "compare with the supply's power at constant speed: a wrong gain draws no power"
        ),
        Confusion("load_dependent_friction", "hold the arm still at several loads"),
    )
    coefficients_are = (("gain", ""),)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.torque[:, joint][:, None]

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        gain = parameters["gain"]
        way = "high" if gain.value > 0 else "low"
        return (
            f"The torque measured at {who.lower()} reads {100 * abs(gain.value):.1f} ± {100 * gain.std:.1f} % {way}: "
            "the torque constant or its scaling is wrong."
        )
