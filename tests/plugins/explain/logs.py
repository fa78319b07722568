"""Columns of recordings as people have them, and files of such."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cellwatt.tables import write_table
from cellwatt_plugins.explain.input.run import Run


def numbered(stem: str, values: np.ndarray, first: int = 1) -> dict[str, np.ndarray]:
    """One column a joint, ``first`` is the number of the first."""
    return {f"{stem}_{i + first}": values[:, i] for i in range(values.shape[1])}


def measured(run: Run, first: int = 1) -> dict[str, np.ndarray]:
    """What a run's recording has, without its plan."""
    columns = {"t": run.time, **numbered("q", run.position, first), **numbered("tau", run.torque, first)}
    if run.velocity is not None:
        columns |= numbered("qd", run.velocity, first)
    return columns if run.power is None else columns | {"power": run.power}


def parquet(path: Path, columns: Mapping[str, np.ndarray]) -> Path:
    """Columns as a file."""
    write_table(path, dict(columns))
    return path


def logged(folder: Path, run: Run, first: int = 1, **changes: np.ndarray | None) -> Path:
    """The recording of a run as a file; ``changes`` are other columns, None leaves one out."""
    columns = (measured(run, first) | changes).items()
    return parquet(folder / "log.parquet", {name: values for name, values in columns if values is not None})


def paused(columns: Mapping[str, np.ndarray], seconds: float) -> dict[str, np.ndarray]:
    """Columns of a logger that paused for some seconds, half-way."""
    time = columns["t"]
    return {**columns, "t": time + seconds * (np.arange(len(time)) >= len(time) // 2)}


def off_before(columns: Mapping[str, np.ndarray], seconds: float, power: float = 60.0) -> dict[str, np.ndarray]:
    """Columns with some seconds before them in which brakes hold the arm and its drives are off, at ``power`` W."""
    time = columns["t"]
    step, random = float(time[1] - time[0]), np.random.default_rng(3)
    rows = round(seconds / step)
    noise = {"q": 2e-5, "qd": 2e-3, "tau": 0.02, "power": 1.5}
    longer = {"t": time[0] + step * np.arange(rows + len(time))}
    for name, values in columns.items():
        if name != "t":
            kind = name.partition("_")[0]
            level = {"q": values[0], "power": power}.get(kind, 0.0)
            longer[name] = np.append(level + noise[kind] * random.standard_normal(rows), values)
    return longer
