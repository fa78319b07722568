"""Roll out a simulator's file under recorded commands, starting at recorded states, and compare it with the arm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.mjcf import compiled, library
from cellwatt_plugins.robot.servo.law import actuator_of

WINDOW = 2.0
"""Length of a roll-out, s; each starts at the recorded state of the arm."""
LOST = np.pi
"""Largest error, rad, that is counted: a simulator that diverges is no more than wrong."""


@dataclass(frozen=True)
class RolledOut:
    """Simulated positions (N, n) rad of a run; NaN where it was not simulated."""

    position: Float
    error: Float
    """Simulated minus recorded positions (N, n) rad, within ± ``LOST``."""


def rolled_out(path: Path, joints: Sequence[str], runs: Sequence[Run]) -> list[RolledOut]:
    """Roll out each run in windows of ``WINDOW`` s. Raises ``ConfigError`` if the file is wrong."""
    model = compiled(path)
    return [_run(path, model, joints, run) for run in runs]


def rms_of(rolled: Sequence[RolledOut]) -> Float:
    """Root mean square error (n,) rad over the runs."""
    squares = np.concatenate([np.square(one.error) for one in rolled])
    return np.asarray(np.sqrt(np.nanmean(squares, axis=0)))


def _run(path: Path, model: Any, joints: Sequence[str], run: Run) -> RolledOut:
    assert run.drive is not None and run.command is not None
    mujoco = library(path)
    data = mujoco.MjData(model)
    named = [model.joint(name) for name in joints]
    at, dof = [j.qposadr[0] for j in named], [j.dofadr[0] for j in named]
    drives = [actuator_of(model, j.id) for j in named]
    moved, step = run.drive.moved, model.opt.timestep
    out, error = (np.full_like(run.position, np.nan) for _ in range(2))
    for first, last in _windows(run):
        mujoco.mj_resetData(model, data)
        data.qpos[at], data.qvel[dof] = moved.position[first], moved.velocity[first]
        time = run.time[first]
        for row in range(first, last):
            data.ctrl[drives] = run.command[row]
            mujoco.mj_step(model, data, max(0, round((run.time[row + 1] - time) / step)) or 1)
            time = run.time[first] + data.time
            # The rest of the row is shorter than a step.
            out[row + 1] = data.qpos[at] + (run.time[row + 1] - time) * data.qvel[dof]
        off = out[first + 1 : last + 1] - moved.position[first + 1 : last + 1]
        error[first + 1 : last + 1] = np.clip(np.nan_to_num(off, nan=LOST, posinf=LOST, neginf=-LOST), -LOST, LOST)
    return RolledOut(out, error)


def _windows(run: Run) -> Iterator[tuple[int, int]]:
    """First and last row of each window without gaps."""
    per = min(max(2, round(WINDOW / run.step)), len(run.time) - 1)
    for first in range(0, len(run.time) - per, per):
        if not run.filled[first : first + per + 1].any():
            yield first, first + per
