"""Winding resistance that grows with temperature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.drive import copper_loss
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.effects.supply.thermal import warmth

TIME_CONSTANTS = (20.0, 50.0, 120.0, 300.0, 700.0, 1500.0)
"""Time constants in s that are tried."""
COPPER = 0.00393
"""Relative rise of copper's resistance, 1/K."""


class WindingTemperature(Effect):
    """Copper loss · 0.393 %/K · temperature rise; recorded, or a state warmed by each winding's own loss.

    Shape: (0,) with recorded temperatures, else (time constant,); the coefficient is then K per W of loss.
    """

    name = "winding_temperature"
    acts_on = "supply"
    depends_on = "fitted torque"
    acceptance = Acceptance(above=0.0, longest_run=60.0)
    confusions = (
        Confusion("converter_efficiency", "hold a load at rest for minutes: only windings warm up"),
        Confusion("fan_switching", "hold a load at rest for minutes: windings warm steadily"),
    )
    sentence = "Copper loss grows while the windings warm up: the temperature of the windings is missing."

    def possible(self, robot: RobotDescription, joint: int | None) -> bool:
        return any(j.winding_resistance > 0 for j in robot.joints)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        longest = max(float(run.time[-1] - run.time[0]) for run in runs)
        states = [(tau,) for tau in TIME_CONSTANTS if tau < 3 * longest]
        return [(0.0,), *states] if all(run.temperature is not None for run in runs) else states

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        loss = copper_loss(run.robot, run.torque)
        if shape[0] == 0:
            rise = np.zeros_like(loss) if run.temperature is None else run.temperature - REFERENCE
        else:
            rise = warmth(loss, run.step, shape[0])
        return np.asarray(COPPER * np.sum(loss * rise, axis=1))[:, None]

    def bounds(self, shape: Shape) -> Sequence[tuple[float, float]]:
        return [(0.0, 0.0)] if shape[0] == 0 else [(5.0, 5000.0)]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        if estimate.shape[0] == 0:
            return {"share": estimate.coefficient(0, "")}
        return {"rise": estimate.coefficient(0, "K/W"), "time_constant": estimate.shaped(0, "s")}


REFERENCE = 20.0
"""°C at which resistances are stated."""
