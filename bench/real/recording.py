"""A recording as arrays, and as the table that `explain` takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cellwatt.arrays import rows_of

Float = NDArray[np.float64]

MOVING = 2e-3
"""rad/s above which a joint moves."""
MARGIN = 0.3
"""s left out after the first and before the last motion."""


@dataclass(frozen=True)
class Recording:
    """N samples of n joints as their source gives them, evenly spaced or not."""

    name: str
    time: Float
    """(N,) s, from 0."""
    position: Float
    """(N, n) rad."""
    velocity: Float
    """(N, n) rad/s."""
    current: Float | None = None
    """(N, n) A."""
    torque: Float | None = None
    """(N, n) Nm; NaN where a joint's is not known."""
    dropped: int = 0
    """Rows that are damaged in the source."""

    def effort(self, constants: Float) -> Float:
        """Torque (N, n) Nm as measured, or current times ``constants`` (n,) Nm/A."""
        if self.torque is not None:
            return self.torque
        if self.current is None:
            raise ValueError(f"{self.name} has neither torque nor current")
        return self.current * constants

    def moving(self) -> Recording:
        """The part between the first and the last motion: a resting joint holds any torque within its friction."""
        moves = self.time[np.abs(self.velocity).max(axis=1) > MOVING]
        return self.between(moves[0] + MARGIN, moves[-1] - MARGIN)

    def between(self, start: float, end: float) -> Recording:
        """The part from ``start`` to ``end`` s."""
        return rows_of(self, (self.time >= start) & (self.time <= end))

    def save(self, folder: Path) -> Path:
        """Write ``<name>.recording.parquet``: t, q_i, qd_i and current_i or tau_i where known, joints from 1."""
        groups = {"q": self.position, "qd": self.velocity, "current": self.current, "tau": self.torque}
        columns = {"t": self.time}
        for stem, values in groups.items():
            if values is not None:
                known = np.flatnonzero(~np.isnan(values).all(axis=0))
                columns |= {f"{stem}_{j + 1}": values[:, j] for j in known}
        path = folder / f"{self.name}.recording.parquet"
        pq.write_table(pa.table(columns), path)
        return path
