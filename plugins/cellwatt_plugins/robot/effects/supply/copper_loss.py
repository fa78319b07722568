"""Heat of the windings that the simulation leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

APART = 0.2
"""Share of the variance of the windings' resistances that is independent: the motors of one arm are alike."""


class CopperLoss(Effect):
    """R (torque / torque constant)² of each joint, where the description has no resistance."""

    name = "copper_loss"
    acts_on = "supply"
    depends_on = "fitted torque"
    acceptance = Acceptance(above=0.0, usual=True)
    confusions = (
        Confusion("converter_efficiency", "hold the arm at several loads: at rest only copper heats"),
        Confusion("standby_power", "hold the arm at several loads"),
    )

    def possible(self, robot: RobotDescription, joint: int | None) -> bool:
        return all(j.winding_resistance == 0 for j in robot.joints)

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        constants = run.arm.column("torque_constant")
        return np.square(run.torque / np.where(constants > 0, constants, 1.0))

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """Resistances of similar size, at which a winding heats by about ``size`` W on average."""
        scale = size[0] / max(float(np.sqrt(np.mean(np.square(columns)))), 1e-9)
        joints = columns.shape[1]
        alike = APART * np.eye(joints) + (1 - APART) * np.ones((joints, joints))
        return Prior(np.zeros(joints), scale**2 * alike)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {f"resistance_{i + 1}": estimate.coefficient(i, "ohm") for i in range(len(estimate.coefficients))}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        ohms = ", ".join(f"{p.value:.2g}" for p in parameters.values())
        return f"The supply also heats the windings (resistances {ohms} Ω by joint): copper loss is missing."
