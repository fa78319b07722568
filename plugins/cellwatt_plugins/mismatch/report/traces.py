"""Traces for the report: each run with the simulation, the retuned law and the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.mismatch.model import Model, predict_states
from cellwatt_plugins.mismatch.report import Trace
from cellwatt_plugins.mismatch.verdict.estimates import retuned


def traces_of(runs: Sequence[Run], model: Model, torque: Solution, nominal: Solution) -> list[Trace]:
    """Return one trace a run, at all samples; ``torque`` and ``nominal`` are the solutions with and without effects."""
    refit = replace(model, retuned=retuned(nominal, None), terms=())
    out = []
    for run, states in zip(runs, torque.problem.states, strict=True):
        tuned, full = predict_states(refit, states), predict_states(model, states)
        simulated = states.nominal
        power = states.with_torque(simulated).nominal_power
        parts = [(run.torque, run.power), (simulated, power), (tuned.torque, tuned.power), (full.torque, full.power)]
        joints = run.joints
        names, units = (
            tuple(f"tau_{i + 1}" for i in range(joints)),
            tuple(model.robot.unit(i, "N*m") for i in range(joints)),
        )
        if run.power is not None:
            names, units = (*names, "power"), (*units, "W")
        measured, stated, refitted, modelled = (
            np.asarray(t if run.power is None or p is None else np.column_stack([t, p])) for t, p in parts
        )
        out.append(Trace(run.name, run.time, states.q, states.qd, names, units, measured, stated, refitted, modelled))
    return out
