"""Tables that a person brings: how their columns name channels, and their reading and writing."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from cellwatt.errors import CellwattError, RecordingError
from cellwatt.files import check_file
from cellwatt.parquet import read_parquet
from cellwatt.record import Recording

Float = NDArray[np.float64]

STEMS: Mapping[str, tuple[str, ...]] = {
    "position": ("q", "actual_q"),
    "velocity": ("qd", "actual_qd"),
    "acceleration": ("qdd",),
    "torque": ("torque", "tau"),
    "current": ("current", "actual_current"),
    "temperature": ("temperature", "joint_temperatures"),
}
"""What tables call the quantities of joint i, before ``_i``; where there is a ``_0``, counted from 0 as in RTDE."""
PLAIN: Mapping[str, tuple[str, ...]] = {"supply.power": ("power",), "tool.payload": ("payload",)}
"""What tables call channels that belong to no joint."""
_JOINT = re.compile(r"joint_(\d+)\.(\w+)")


def channel_of(channel: str, columns: Mapping[str, Float], place: Path) -> Float | None:
    """The column (n,) of a channel, under its own name, with a source before it, or as tables name it.

    ``joint_i.approach`` is the way from ``q_from_i``, where the arm came from, to ``q_i``. None where there is none.
    Raises ``RecordingError`` where several sources give the channel.
    """
    found = [name for name in columns if name == channel or name.endswith(f".{channel}")]
    if len(found) > 1:
        raise RecordingError(f"{place}: {' and '.join(found)} are there for {channel}: keep the columns of one arm")
    if found:
        return columns[found[0]]
    if (match := _JOINT.fullmatch(channel)) is None:
        return next((columns[name] for name in PLAIN.get(channel, ()) if name in columns), None)
    joint, quantity = match.groups()
    if quantity == "approach":
        here, before = (_of_joint(stem, int(joint), columns) for stem in ("q", "q_from"))
        return None if here is None or before is None else here - before
    found_of = (_of_joint(stem, int(joint), columns) for stem in STEMS.get(quantity, ()))
    return next((column for column in found_of if column is not None), None)


def _of_joint(stem: str, joint: int, columns: Mapping[str, Float]) -> Float | None:
    first = 0 if f"{stem}_0" in columns else 1
    return columns.get(f"{stem}_{joint - 1 + first}")


def read_table(path: Path) -> pa.Table:
    """A Parquet or CSV file, or the frames of a recording of cellwatt (then with ``t`` s since its start).

    Raises ``RecordingError`` where it cannot be read or has no rows.
    """
    try:
        if path.suffix == ".parquet":
            table = read_parquet(path)
        elif path.suffix in {".csv", ".txt"}:
            check_file(path)
            table = pyarrow.csv.read_csv(path)
        else:
            table = _frames(path)
        names = table.column_names
    except (OSError, pa.ArrowException, ValueError) as error:  # the last: names that are not UTF-8
        raise RecordingError(f"{path}: cannot be read as a table: {str(error).splitlines()[0]}") from error
    if not names or not table.num_rows:
        raise RecordingError(f"{path}: has no rows")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: two columns are called {twice!r}")
    return table


def write_table(table: pa.Table, path: Path) -> None:
    """Writes Parquet, or CSV where the name says so. Raises ``CellwattError`` where that cannot be."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".csv":
            pyarrow.csv.write_csv(table, path)
        else:
            pq.write_table(table, path)
    except OSError as error:
        raise CellwattError(f"{path} cannot be written: {(error.strerror or str(error)).lower()}") from error


def _frames(path: Path) -> pa.Table:
    blocks = list(Recording.open(path).frames())
    if not blocks:
        raise RecordingError(f"{path}: has no frames")
    if any(block.layout != blocks[0].layout for block in blocks):
        raise RecordingError(f"{path}: the channels or the rate of the frames change within it")
    time = np.concatenate([block.time for block in blocks])
    values = np.concatenate([block.values for block in blocks])
    return pa.table({"t": (time - time[0]) * 1e-9, **dict(zip(blocks[0].layout.names, values.T, strict=True))})
