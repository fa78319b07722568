"""Supply power that is drive power over an efficiency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.drive import copper_gain, drive_power
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States

ALL, MOTORING, BOTH_WAYS = 0.0, 1.0, 2.0
BACK = 0.9
"""Typical efficiency of regenerated power, if the converter is lossy both ways."""


class ConverterEfficiency(Effect):
    """(1/efficiency - 1) · drive power; of all drive power, only while motoring, or lost both ways."""

    name = "converter_efficiency"
    acts_on = "supply"
    depends_on = "fitted torque"
    acceptance = Acceptance(above=0.015)
    plausible = (lambda c: float(c[0])), 0.0, 1.5
    """A converter that passes on less than 40 % would burn."""
    confusions = (
        Confusion("copper_loss", "hold the arm at several loads: at rest only copper heats"),
        Confusion("torque_gain", "compare with torque from gravity at rest: an efficiency leaves it alone"),
    )
    tried = ((ALL,), (MOTORING,), (BOTH_WAYS,))

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        total = np.sum(drive_power(copper_gain(run.robot), run.torque, run.qd), axis=1, dtype=np.float64)
        if shape[0] == ALL:
            return np.asarray(total)[:, None]
        back = BACK * np.maximum(-total, 0.0) if shape[0] == BOTH_WAYS else 0.0
        return np.asarray(np.maximum(total, 0.0) + back)[:, None]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        more = estimate.coefficients[0]
        std = float(np.sqrt(estimate.covariance[0, 0])) / (1 + more) ** 2
        return {"efficiency": Parameter(float(1 / (1 + more)), std, "")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        share = parameters["efficiency"]
        return (
            f"Between supply and drives only {100 * share.value:.1f} ± {100 * share.std:.1f} % of the power arrives: "
            "the converter's efficiency is missing."
        )
