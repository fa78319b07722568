"""Traces for the report: each run with the simulation and the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.mismatch.model import Model, predict_states
from cellwatt_plugins.mismatch.report import Trace


def traces_of(runs: Sequence[Run], model: Model, solution: Solution) -> list[Trace]:
    """Return one trace a run, at all samples; ``solution`` holds the runs' states."""
    out, joints = [], range(len(model.robot.joints))
    for run, states in zip(runs, solution.problem.states, strict=True):
        full = predict_states(model, states)
        powered = run.power is not None
        names = (*(f"tau_{i + 1}" for i in joints), *["power"] * powered)
        units = (*(model.robot.unit(i, "N*m") for i in joints), *["W"] * powered)
        power = states.with_torque(states.nominal).nominal_power
        measured, stated, modelled = (
            torque if run.power is None or p is None else np.column_stack([torque, p])
            for torque, p in ((run.torque, run.power), (states.nominal, power), (full.torque, full.power))
        )
        out.append(Trace(run.name, run.time, states.q, states.qd, names, units, measured, stated, modelled))
    return out
