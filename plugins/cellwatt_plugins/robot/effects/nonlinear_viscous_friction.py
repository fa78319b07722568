"""Viscous friction that does not grow in proportion to speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Estimate, Float, Parameter, Shape, said
from cellwatt_plugins.robot.effects.friction import Friction, Sliding
from cellwatt_plugins.robot.effects.states import States

EXPONENTS = (0.3, 0.5, 0.7, 1.5, 2.0, 2.5, 3.0)
SLOW = 0.0
"""In the place of the exponent: friction that turns over within a speed, instead of at once."""
SPEEDS = (0.02, 0.035, 0.06, 0.1, 0.18, 0.3)
"""rad/s within which friction is tried to turn over."""


class NonlinearViscousFriction(Friction):
    """c · |w|^a sign(w) with a other than 1, or c · (tanh(w/ws) - sign(w)): Coulomb friction that turns over slowly."""

    name = "nonlinear_viscous_friction"
    acts_on = "friction"
    acceptance = Acceptance(inside_bounds=True)
    trained = MappingProxyType({"quadratic viscous friction": (2.0,), "cubic viscous friction": (3.0,)})
    split = 0.5, (2.0,)
    confusions = (
        Confusion("stribeck_friction", "sweep at six constant speeds over two decades, up to full speed"),
        Confusion("temperature_dependent_friction", "repeat the same cycle cold and warm"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        fastest = max(float(np.max(np.abs(run.qd[:, joint]))) for run in runs)
        return [*((a,) for a in EXPONENTS), *((SLOW, speed) for speed in SPEEDS if speed < 0.5 * fastest)]

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        return shape[0] != SLOW or bool(coefficients[0] > 0)

    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        if shape[0] == SLOW:
            return np.tanh(sliding.qd / shape[1]) - sliding.sign
        return np.abs(sliding.qd) ** shape[0] * sliding.sign

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        if shape[0] == SLOW:
            return [(SLOW, SLOW), (0.01, 0.5)]
        return [(0.15, 0.85)] if shape[0] < 1 else [(1.2, 5.0)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        if estimate.shape[0] == SLOW:
            return {"force": estimate.coefficient(0, "N*m"), "velocity": estimate.shaped(1, "rad/s")}
        return {"coefficient": estimate.coefficient(0, "N*m"), "exponent": estimate.shaped(0, "")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        if "force" in parameters:
            return (
                f"Friction of {who.lower()} ({said(parameters['force'])}) turns over slowly, within about "
                f"{parameters['velocity'].value:.2g} rad/s, and not at once with the direction of motion."
            )
        grows = "faster" if parameters["exponent"].value > 1 else "slower"
        return (
            f"Friction of {who.lower()} grows {grows} than speed: a term "
            f"{parameters['coefficient'].value:.3g} Nm · w^{parameters['exponent'].value:.2f} is missing."
        )
