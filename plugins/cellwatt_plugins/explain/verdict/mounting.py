"""The mount of the arm, checked before the physics: whether gravity points as in the simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.verdict.findings import Finding, Improvement, Where
from cellwatt_plugins.robot.effects.effect import Parameter
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.mount import Mount, mount


def as_mounted(
    runs: Sequence[Run], states: Sequence[States], base: Baseline
) -> tuple[Baseline, Sequence[States], Finding | None]:
    """Baseline and states with the gravity found from the recordings; unchanged where the simulation's is right."""
    q, qd, qdd = (np.concatenate([getattr(s, name) for s in states]) for name in ("q", "qd", "qdd"))
    found = mount(states[0].arm.body, q, qd, qdd, _residual(runs, states))
    if found is None:
        return base, states, None
    base = replace(base, recorded=base.recorded.with_gravity(found.field))
    new = [replace(s, arm=base.recorded, fitted=None, carried=None) for s in states]
    return base, new, _finding(found, base, errors(runs, states), errors(runs, new))


def errors(runs: Sequence[Run], states: Sequence[States]) -> Float:
    """Rms (n,) Nm of measured minus simulated torque; 0 where no torque was measured."""
    off = _residual(runs, states)
    read = np.isfinite(off)
    return np.asarray(np.sqrt(np.sum(np.where(read, off, 0.0) ** 2, axis=0) / np.maximum(np.sum(read, axis=0), 1)))


def _residual(runs: Sequence[Run], states: Sequence[States]) -> Float:
    return np.concatenate([run.torque - s.nominal for run, s in zip(runs, states, strict=True)])


def _finding(found: Mount, base: Baseline, before: Float, after: Float) -> Finding:
    was, now = base.arm.body.gravity_field, found.field
    gone = before - after
    best = int(np.argmax(gone))
    felt = tuple(f"tau_{j + 1}" for j in np.flatnonzero(gone > 0.1 * gone[best]))
    parameters = {
        f"gravity_{axis}": Parameter(float(value), float(std), "m/s^2")
        for axis, value, std in zip("xyz", now, found.std, strict=True)
    }
    statement = (
        f"The base is mounted differently from the simulation: in its frame gravity is {_vector(now)} m/s², not "
        f'{_vector(was)}. In an MJCF, set <option gravity="{_vector(now)[1:-1].replace(",", "")}"/> if the base '
        "is not turned."
    )
    unit = base.arm.description.unit(best, "N*m")
    error = Improvement(f"tau_{best + 1}", unit, float(before[best]), float(after[best]), 0.0, False)
    return Finding("gravity_tilt", None, "missing", 0.99, statement, parameters, Where(felt), error)


def _vector(field: Float) -> str:
    return "(" + ", ".join(f"{value + 0.0:.2f}" for value in field) + ")"
