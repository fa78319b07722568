"""Recordings as tables for other tools: Parquet or CSV, one file a stream, written piece by piece."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from cellwatt.batch import Batch
from cellwatt.channel import Channel
from cellwatt.errors import RecordingError
from cellwatt.frames import FrameChannel, Frames
from cellwatt.record.header import Header

Format = Literal["parquet", "csv"]
ROWS = 32768
"""Rows held back before they are written together."""


class Table:
    """A file of columns: ``t`` (s since ``start``, UTC ns), ``utc_ns``, one a channel, then what is known of them.

    Units stand in the columns' metadata (Parquet) or in a JSON file beside the table (CSV). Use as a
    context manager. Raises ``RecordingError`` where the file cannot be written.
    """

    def __init__(self, path: Path, channels: Sequence[Channel | FrameChannel], start: int, header: Header) -> None:
        self.path = path
        self.rows = 0
        self._channels = channels
        self._start = start
        self._header = header
        self._held: list[pa.RecordBatch] = []
        self._writer: Any = None
        self._stack = ExitStack()

    def __enter__(self) -> Table:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        with self._stack:
            if kind is None:
                self._flush()
                self._describe()

    def add_batch(self, batch: Batch) -> None:
        """Append raw samples: with sequence, arrival, device time, bound and quality."""
        n = len(batch)
        nothing = pa.nulls(n, pa.int64())
        self._add(
            batch.time,
            batch.values,
            {
                "sequence": pa.array(np.arange(batch.sequence, batch.sequence + n)),
                "arrival_ns": pa.array(np.full(n, batch.arrival)),
                "device_time_ns": nothing if batch.device_time is None else pa.array(batch.device_time),
                "bound_ns": pa.array(batch.bound),
                "quality": pa.array(batch.quality),
            },
        )

    def add_frames(self, frames: Frames) -> None:
        """Append frames: with quality and bound of each channel."""
        columns: dict[str, Any] = {"sequence": pa.array(np.arange(frames.sequence, frames.sequence + len(frames)))}
        for i, name in enumerate(frames.layout.names):
            columns[f"{name}.quality"] = pa.array(np.ascontiguousarray(frames.quality[:, i]))
            columns[f"{name}.bound_ns"] = pa.array(np.ascontiguousarray(frames.bound[:, i]))
        self._add(frames.time, frames.values, columns)

    def _add(self, time: Any, values: Any, more: dict[str, Any]) -> None:
        columns = {"t": pa.array((time - self._start) / 1e9), "utc_ns": pa.array(time)}
        for i, channel in enumerate(self._channels):
            columns[channel.name] = pa.array(np.ascontiguousarray(values[:, i]))
        columns |= more
        fields = [pa.field(name, c.type, metadata=self._units(name)) for name, c in columns.items()]
        self._held.append(pa.record_batch(list(columns.values()), schema=pa.schema(fields)))
        self.rows += len(time)
        if sum(map(len, self._held)) >= ROWS:
            self._flush()

    def _units(self, name: str) -> dict[str, str] | None:
        fixed = {"t": "s", "utc_ns": "ns", "arrival_ns": "ns", "device_time_ns": "ns", "bound_ns": "ns"}
        units = {channel.name: channel.unit for channel in self._channels}
        unit = units.get(name) or fixed.get(name) or ("ns" if name.endswith(".bound_ns") else None)
        return {"unit": unit} if unit else None

    def _flush(self) -> None:
        if not self._held:
            return
        table = pa.Table.from_batches(self._held).combine_chunks()
        self._held = []
        try:
            if self._writer is None:
                self._writer = self._open(table.schema)
            self._writer.write_table(table)
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be written: {error}") from error

    def _open(self, schema: Any) -> Any:
        if self.path.suffix == ".csv":
            # pyarrow would put every name in quotes, which simple readers take for part of the name.
            with self.path.open("w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerow(schema.names)
            options = pyarrow.csv.WriteOptions(include_header=False)
            out = self._stack.enter_context(self.path.open("ab"))
            return self._stack.enter_context(pyarrow.csv.CSVWriter(out, schema, write_options=options))
        about = schema.with_metadata({"cellwatt": json.dumps(self._about())})
        return self._stack.enter_context(pyarrow.parquet.ParquetWriter(self.path, about, compression="zstd"))

    def _describe(self) -> None:
        if self.path.suffix == ".csv" and self._writer is not None:
            units = {channel.name: channel.unit for channel in self._channels}
            self.path.with_suffix(".json").write_text(json.dumps({**self._about(), "units": units}, indent=2) + "\n")

    def _about(self) -> dict[str, Any]:
        header = self._header
        return {"site": header.site, "cell": header.cell, "session": header.session, "start_utc_ns": self._start}


def write_lines(path: Path, items: Iterable[bytes]) -> int:
    """JSON lines; gives how many, and leaves no file where there are none. Raises ``RecordingError``."""
    lines = list(items)
    if lines:
        try:
            path.write_bytes(b"\n".join(lines) + b"\n")
        except OSError as error:
            raise RecordingError(f"{path} cannot be written: {error.strerror}") from error
    return len(lines)
