"""Measured torque whose offset moves with time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States

TIMES = (0.0, 10.0, 40.0, 150.0)
"""Time constants in s that are tried; 0 is a steady drift."""


class TorqueDrift(Effect):
    """An offset that grows steadily from the start of a run, or settles with a time constant."""

    name = "torque_drift"
    acts_on = "reading"
    relations = Relations(beats=("torque_offset",))
    confusions = (
        Confusion("temperature_dependent_friction", "hold the arm still for minutes: a drift goes on, friction rests"),
    )

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        longest = max(float(run.time[-1] - run.time[0]) for run in runs)
        return [(tau,) for tau in TIMES if tau < longest]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        since = run.time - run.time[0]
        course = since / 60.0 if shape[0] == 0 else 1 - np.exp(-since / shape[0])
        return np.asarray(course)[:, None]

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        if estimate.shape[0] == 0:
            return {"rate": estimate.coefficient(0, "N*m/min")}
        return {"drift": estimate.coefficient(0, "N*m"), "time_constant": estimate.shaped(0, "s")}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        size = parameters["rate"] if "rate" in parameters else parameters["drift"]
        return f"The torque measured at {who.lower()} drifts by {size} within each run: its offset moves with time."
