"""Traces for the report: each run with the simulation, the retuned law and the model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.explain import Explained
from cellwatt_plugins.mismatch.model import Model, predict_states
from cellwatt_plugins.mismatch.report import Trace
from cellwatt_plugins.mismatch.verdict.estimates import retuned

Float = NDArray[np.float64]


def traces_of(found: Explained) -> list[Trace]:
    """One trace a run, at all samples."""
    robot = found.model.robot
    refit = Model(robot, retuned(found.nominal, None), links=found.model.links)
    out = []
    for run, states in zip(found.runs, found.torque.problem.states, strict=True):
        tuned, model = predict_states(refit, states), predict_states(found.model, states)
        simulated = states.nominal
        power = states.with_torque(simulated).nominal_power
        parts = [(run.torque, run.power), (simulated, power), (tuned.torque, tuned.power), (model.torque, model.power)]
        joints = run.joints
        names, units = tuple(f"tau_{i + 1}" for i in range(joints)), ("N*m",) * joints
        if run.power is not None:
            names, units = (*names, "power"), (*units, "W")
        measured, nominal, refitted, modelled = (
            np.asarray(t if run.power is None or p is None else np.column_stack([t, p])) for t, p in parts
        )
        out.append(Trace(run.name, run.time, states.q, states.qd, names, units, measured, nominal, refitted, modelled))
    return out


def noise_floors(found: Explained) -> Float:
    """Noise floor (C,) of all channels."""
    torque = found.torque.problem.floor
    return torque if found.supply is None else np.append(torque, found.supply.problem.floor)
