"""Friction that falls as the joint warms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.drive import copper_loss
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.effects.supply.thermal import warmth

SCALES = (4.0, 7.0, 10.0, 14.0, 20.0, 35.0)
"""Rises in °C over which friction falls by e, tried where the temperature is recorded."""
TIME_CONSTANTS = (60.0, 120.0, 240.0, 480.0, 900.0, 1800.0)
"""Time constants in s, tried where the temperature is not recorded."""
DEPTHS = (0.4, 0.8, 1.3, 2.0, 3.0)
"""Steady-state warming at the mean loss of all runs, in units of the scale, where no temperature is recorded."""


class TemperatureDependentFriction(Effect):
    """Added friction · exp(-(T - start) / scale); T is recorded, or a state warmed by the joint's own losses.

    The coefficient is Nm of Coulomb and viscous friction, in their described ratio. Shape: (scale, 0) with a recorded
    temperature, else (time constant, warming): the steady state per W of loss, in units of the scale.
    """

    name = "temperature_dependent_friction"
    of_motor = True
    acts_on = "friction"
    acceptance = Acceptance(above=0.0, longest_run=100.0)
    uncertainty = Uncertainty({"cold_factor": 0.15, "scale": 0.05, "time_constant": 0.15, "warming": 0.15})
    """They are relative to nominal friction, which may be wrong by its tolerance."""
    confusions = (
        Confusion("viscous_friction", "repeat the same cycle cold and warm"),
        Confusion("torque_drift", "hold the arm still for minutes: friction is constant, a drift continues"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        if all(run.temperature is not None for run in runs):
            return [(scale, 0.0) for scale in SCALES]
        mean = float(np.mean(np.concatenate([_loss(run, joint or 0) for run in runs])))
        return [(tau, depth / max(mean, 1e-9)) for tau in TIME_CONSTANTS for depth in DEPTHS]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        axis = joint or 0
        if shape[1] == 0:
            if run.temperature is None:
                return np.zeros((len(run.time), 1))
            factor = np.exp(-(run.temperature[:, axis] - COLD) / shape[0])
        else:
            factor = np.exp(-shape[1] * warmth(_loss(run, axis), run.step, shape[0]))
        parts = run.arm.column("coulomb_friction")[axis], run.arm.column("viscous_friction")[axis]
        size = max(float(np.hypot(*parts)), 1e-9)
        shares = (parts[0] / size or 1.0, parts[1] / size or 1.0)
        friction = shares[0] * run.sign[:, axis] + shares[1] * run.qd[:, axis]
        return (factor * friction)[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        if shape[1] == 0:
            return [(2.0, 80.0), (0.0, 0.0)]
        return [(30.0, 4000.0), (0.1 * shape[1], 10 * shape[1])]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        parts = robot.joints[joint or 0].coulomb_friction, robot.joints[joint or 0].viscous_friction
        size = float(np.hypot(*parts)) or 1.0
        factor = Parameter(float(estimate.coefficients[0] / size), float(np.sqrt(estimate.covariance[0, 0]) / size), "")
        if estimate.shape[1] == 0:
            return {"cold_factor": factor, "scale": estimate.shaped(0, "K")}
        return {"cold_factor": factor, "time_constant": estimate.shaped(0, "s"), "warming": estimate.shaped(1, "1/W")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        more = 100 * parameters["cold_factor"].value
        if "scale" in parameters:
            return (
                f"Friction of {who.lower()} is {more:.0f} % higher at {COLD:.0f} °C and falls by e every "
                f"{parameters['scale'].value:.1f} K: temperature-dependent friction is missing."
            )
        return (
            f"Friction of {who.lower()} is {more:.0f} % higher cold and falls within about "
            f"{parameters['time_constant'].value / 60:.0f} min of work: temperature-dependent friction is missing."
        )


def _loss(run: States, axis: int) -> Float:
    """Heat (N,) W of a joint's gear and winding."""
    return np.abs(run.friction[:, axis] * run.qd[:, axis]) + copper_loss(run.robot, run.nominal)[:, axis]


COLD = 20.0
"""°C at which the cold factor is stated."""
