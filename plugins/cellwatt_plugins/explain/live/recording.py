"""Writes a stretch of the compared frames as a recording for ``cellwatt explain``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.tables import usual, write_table
from cellwatt_plugins.explain.live.intake import Intake
from cellwatt_plugins.robot import RobotDescription

WHOLE = 0.995
"""Smallest share of rows with a quantity for it to be written; the reader interpolates the rest.

Torques are always written: a joint without torque is excluded on its own.
"""


def write_recording(path: Path, intake: Intake, time: NDArray[np.int64], rows: Float) -> None:
    """Write rows (N, width) at ``time`` (N,) ns as Parquet; t starts at 0, torque computed by law is omitted.

    Raises ``RecordingError``.
    """
    columns: dict[str, Float] = {"t": (time - time[0]) * 1e-9}
    for quantity, place in intake.places.items():
        if quantity == "torque" and intake.driven:
            continue
        table = rows[:, place] / intake.gain if quantity == "current" else rows[:, place]
        if quantity != intake.measured and not _whole(table):
            continue
        if quantity == "power":
            columns["power"] = table[:, 0]
        else:
            columns |= {usual(quantity, i + 1): table[:, i] for i in range(table.shape[1])}
    write_table(path, columns)


def write_simulation(path: Path, intake: Intake, time: NDArray[np.int64], rows: Float) -> None:
    """Write the streamed simulation in rows (N, width + C), with the commanded motion where it is recorded.

    Raises ``RecordingError``.
    """
    places = intake.places
    columns: dict[str, Float] = {"t": (time - time[0]) * 1e-9}
    for key, name in (("position", "q"), ("velocity", "qd")):
        source = f"target_{key}" if f"target_{key}" in places else key
        if source in places and _whole(table := rows[:, places[source]]):
            columns |= {f"{name}_{i + 1}": table[:, i] for i in range(table.shape[1])}
    simulated = rows[:, max(place.stop for place in places.values()) :]
    names = ["power" if judged.joint is None else f"tau_{judged.joint}" for judged in intake.judged]
    write_table(path, columns | dict(zip(names, simulated.T, strict=True)))


def _whole(table: Float) -> bool:
    return bool(np.isfinite(table).all(axis=1).mean() >= WHOLE)


def write_robot(path: Path, robot: RobotDescription) -> None:
    """Write the description with an absolute path to its URDF. Raises ``RecordingError``."""
    content = robot.model_dump(mode="json", exclude_none=True) | {"urdf": str(robot.urdf.absolute())}
    try:
        path.write_text(yaml.safe_dump(content, sort_keys=False))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be written: {error.strerror or error}") from error
