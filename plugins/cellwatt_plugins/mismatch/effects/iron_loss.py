"""Loss that grows with speed, not with torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt_plugins.mismatch.effects.effect import Confusion, Effect, Estimate, Float, Shape
from cellwatt_plugins.mismatch.findings import Parameter
from cellwatt_plugins.mismatch.regression import Prior
from cellwatt_plugins.mismatch.states import States
from cellwatt_plugins.robot.description import RobotDescription

EXPONENTS = (1.0, 1.5, 2.0)


class IronLoss(Effect):
    """Σ c |w|^a over the joints, the coefficients of one size but not the same: motors differ."""

    name = "iron_loss"
    place = "supply"
    confusions = (
        Confusion("brake_power", "move slowly and fast: brakes draw the same, iron more"),
        Confusion("converter_efficiency", "move fast without load and slowly with load"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        return [(a,) for a in EXPONENTS]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return np.abs(run.qd) ** shape[0]

    def sensible(self, coefficients: Float, robot: RobotDescription, joint: int | None) -> bool:
        return bool(np.mean(coefficients) > 0)

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        own = np.sqrt(np.diag(super().prior(runs, joint, columns, size).covariance))
        joints = len(own)
        alike = 0.5 * (np.ones((joints, joints)) + np.eye(joints))
        return Prior(np.zeros(joints), alike * np.outer(own, own) / joints)

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.8, 2.4)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        joints = len(estimate.coefficients)
        mean = np.zeros(len(estimate.covariance))
        mean[:joints] = 1 / joints
        std = float(np.sqrt(mean @ estimate.covariance @ mean))
        each = {f"coefficient_{i + 1}": estimate.coefficient(i, "W") for i in range(joints)}
        average = Parameter(float(np.mean(estimate.coefficients)), std, "W")
        return {"coefficient": average, "exponent": estimate.shaped(0, ""), **each}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return (
            f"The supply draws {parameters['coefficient'].value:.3g} W · Σ|w|^{parameters['exponent'].value:.2g} with "
            "speed, whatever the torque: iron loss is missing."
        )
