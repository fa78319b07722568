"""Negative drive power that goes to a brake resistor instead of back to the supply."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.drive import copper_gain, drive_power
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States

TOTAL, EACH = 0.0, 1.0


class RegenerationDissipated(Effect):
    """-min(drive power, 0), of all drives together on one bus or of each drive."""

    name = "regeneration_dissipated"
    acts_on = "supply"
    depends_on = "fitted torque"
    acceptance = Acceptance(above=0.05)
    plausible = (lambda c: float(c[0])), 0.0, 1.2
    """No more power can be lost than the braking drives return."""
    confusions = (Confusion("converter_efficiency", "lower a load fast, then lift it at the same speed"),)
    coefficients_are = (("share", ""),)
    tried = ((TOTAL,), (EACH,))

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        drive = drive_power(copper_gain(run.robot), run.torque, run.qd)
        back = np.maximum(-np.sum(drive, axis=1), 0.0) if shape[0] == TOTAL else np.sum(np.maximum(-drive, 0.0), axis=1)
        return np.asarray(back)[:, None]

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        share = 100 * parameters["share"].value
        return f"{share:.0f} % of the power that braking drives give back is lost: regeneration is dissipated."
