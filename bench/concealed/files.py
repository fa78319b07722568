"""A recording beside its simulation, as the files say it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from concealed.arms import Array


@dataclass(frozen=True)
class Run:
    """One recording beside its simulation: t (N,), planned q, v, a and both torques (N, n), measured power (N,)."""

    name: str
    t: Array
    q: Array
    v: Array
    a: Array
    simulated: Array
    measured: Array
    measured_power: Array


def group(table: pa.Table, name: str) -> Array:
    """(N, n) of the columns name_1, name_2, …"""
    found = [c for c in table.column_names if c.startswith(f"{name}_") and c[len(name) + 1 :].isdigit()]
    return np.stack([table[f"{name}_{j + 1}"].to_numpy() for j in range(len(found))], axis=1).astype(float)


def load_run(recording: Path, keys: Path) -> Run:
    """One recording and what the simulation says at its times: in the keys where the simulation has its own clock."""
    seen = pq.read_table(recording)
    beside = recording.with_name(recording.name.replace(".recording.", ".simulation."))
    simulation = pq.read_table(aligned if (aligned := keys / beside.name).exists() else beside)
    return Run(
        recording.name.split(".")[0],
        seen["t"].to_numpy().astype(float),
        group(simulation, "q"),
        group(simulation, "qd"),
        group(simulation, "qdd"),
        group(simulation, "tau"),
        group(seen, "tau"),
        seen["power"].to_numpy().astype(float),
    )
