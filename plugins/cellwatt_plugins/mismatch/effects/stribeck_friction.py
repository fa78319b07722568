"""Stribeck friction: more at low speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt_plugins.mismatch.effects.declaration import Acceptance, Confusion, Form
from cellwatt_plugins.mismatch.effects.effect import Effect, Estimate, Float, Parameter, Shape, said
from cellwatt_plugins.mismatch.effects.states import States
from cellwatt_plugins.robot.description import RobotDescription

FASTEST = 0.5
"""rad/s: what falls off more slowly is no boundary lubrication of a gear but a bent viscous friction."""
SPEEDS = np.geomspace(0.008, 0.4, 12)
"""rad/s that are tried."""


class StribeckFriction(Effect):
    """excess · exp(-(w/ws)²) sign(w) on top of Coulomb and viscous friction."""

    name = "stribeck_friction"
    acts_on = "friction"
    form = Form(reverses=True)
    acceptance = Acceptance(above=0.0, inside_bounds=True)
    confusions = (
        Confusion("presliding_hysteresis", "reverse slowly at one place: presliding depends on the way since reversal"),
        Confusion("load_dependent_friction", "sweep slowly at two loads: Stribeck friction does not change with load"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        fastest = max(float(np.max(np.abs(run.qd[:, joint]))) for run in runs)
        return [(float(speed),) for speed in SPEEDS if speed < 0.6 * fastest]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return (run.sign[:, joint] * np.exp(-np.square(run.qd[:, joint] / shape[0])))[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.006, FASTEST)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"excess": estimate.coefficient(0, "N*m"), "velocity": estimate.shaped(0, "rad/s")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        return (
            f"{who} needs {said(parameters['excess'])} more below about {parameters['velocity'].value:.2g} rad/s than "
            "Coulomb and viscous friction give: Stribeck friction is missing."
        )
