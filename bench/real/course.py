"""What was measured, what the simulation says and what the explained model says, over one recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cellwatt_plugins.robot import Arm
from real.identify import MOTION_BAND, RATE, low_pass
from real.product import simulate
from real.recording import Float, Recording


@dataclass(frozen=True)
class Course:
    """N samples of n joints on an even grid, (N, n) each."""

    time: Float
    """(N,) s."""
    position: Float
    """rad."""
    velocity: Float
    """rad/s."""
    measured: Float
    """Nm, as are the others."""
    simulation: Float
    model: Float


def course(recording: Recording, robot: Path, explained: Path) -> Course:
    """``robot.yaml`` and the model in the folder ``explained``, both on the recorded motion."""
    arm = Arm.load(robot)
    time = np.arange(recording.time[0], recording.time[-1], 1 / RATE)

    def even(values: Float) -> Float:
        return np.column_stack([np.interp(time, recording.time, one) for one in values.T])

    q, qd = low_pass(even(recording.position), MOTION_BAND), low_pass(even(recording.velocity), MOTION_BAND)
    qdd = np.gradient(qd, 1 / RATE, axis=0)
    simulated = arm.torque(q, qd, qdd)
    measured = even(recording.effort(arm.column("torque_constant")))
    return Course(time, q, qd, measured, simulated, _model(explained, time, q, qd, qdd))


def _model(explained: Path, time: Float, q: Float, qd: Float, qdd: Float) -> Float:
    groups = {"q": q, "qd": qd, "qdd": qdd}
    columns = {"t": time} | {f"{stem}_{j + 1}": v[:, j] for stem, v in groups.items() for j in range(v.shape[1])}
    motion = explained / "motion.parquet"
    pq.write_table(pa.table(columns), motion)
    told = pq.read_table(simulate(explained / "model.yaml", motion, explained / "prediction.parquet"))
    return np.column_stack([told[f"tau_{j + 1}"].to_numpy() for j in range(q.shape[1])])
