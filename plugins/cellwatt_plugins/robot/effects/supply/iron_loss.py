"""Loss that grows with speed, not with torque."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

BOTH = 0.0
"""In place of an exponent: |w| and w² together, for hysteresis and eddy currents."""


class IronLoss(Effect):
    """Σ c |w|^a over the joints, or Σ h |w| + e w²; coefficients of similar size, as motors differ."""

    name = "iron_loss"
    acts_on = "supply"
    form = Form(error=0.01)
    confusions = (
        Confusion("brake_power", "move slowly and fast: brakes draw the same, iron more"),
        Confusion("converter_efficiency", "move fast without load and slowly with load"),
    )
    tried = ((BOTH,), (1.0,), (1.5,), (2.0,))

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        speed = np.abs(run.qd)
        return np.hstack([speed, speed**2]) if shape[0] == BOTH else speed ** shape[0]

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        parts = coefficients.reshape(-1, len(robot.joints))
        return bool(np.all(np.mean(parts, axis=1) > 0))

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        own = np.sqrt(np.diag(super().prior(runs, joint, columns, size).covariance))
        joints = runs[0].qd.shape[1]
        alike = 0.5 * (np.ones((joints, joints)) + np.eye(joints))
        apart = np.kron(np.eye(len(own) // joints), alike)
        return Prior(np.zeros(len(own)), apart * np.outer(own, own) / joints)

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(BOTH, BOTH)] if shape[0] == BOTH else [(0.8, 2.4)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        joints = len(robot.joints)
        both = estimate.shape[0] == BOTH
        out = {}
        for k, name in enumerate(("hysteresis", "eddy") if both else ("coefficient",)):
            out[name] = _average(estimate, slice(k * joints, (k + 1) * joints))
            out |= {f"{name}_{i + 1}": estimate.coefficient(k * joints + i, "W") for i in range(joints)}
        return out if both else {**out, "exponent": estimate.shaped(0, "")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        if "exponent" in parameters:
            law = f"{parameters['coefficient'].value:.3g} W · Σ|w|^{parameters['exponent'].value:.2g}"
        else:
            law = f"{parameters['hysteresis'].value:.3g} W · Σ|w| + {parameters['eddy'].value:.3g} W · Σw²"
        return f"The supply draws {law} with speed, whatever the torque: iron loss is missing."


def _average(estimate: Estimate, columns: slice) -> Parameter:
    """Mean over the joints of one kind of coefficient."""
    mean = np.zeros(len(estimate.covariance))
    mean[columns] = 1 / (columns.stop - columns.start)
    std = float(np.sqrt(mean @ estimate.covariance @ mean))
    return Parameter(float(np.mean(estimate.coefficients[columns])), std, "W")
