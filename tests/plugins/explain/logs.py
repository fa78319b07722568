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
