"""Recordings as tables for other tools: Parquet, CSV and JSON lines, written in blocks, and data frames."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from fnmatch import fnmatchcase
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from cellwatt.batch import Batch
from cellwatt.channel import Channel
from cellwatt.errors import CellwattError, RecordingError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.record.header import Header
from cellwatt.record.samples import Samples, join
from cellwatt.units import Units

Channels = Sequence[Channel | FrameChannel]
SI = Units()
ROWS = 32768
"""Rows that are collected and written together."""
_UNITS = {"t": "s", "utc_ns": "ns", "arrival_ns": "ns", "device_time_ns": "ns", "bound_ns": "ns"}


def sample_rows(samples: Samples, start: int, units: Units = SI) -> pa.RecordBatch:
    """Raw samples as rows: ``t`` s since ``start`` (UTC ns), ``utc_ns``, one column a channel, then sequence, arrival,
    device time, bound and quality of each sample. Values are in ``units``, named in the columns' metadata.
    """
    device_time = pa.nulls(len(samples), pa.int64()) if samples.device_time is None else samples.device_time
    known = {
        "sequence": samples.sequence,
        "arrival_ns": samples.arrival,
        "device_time_ns": device_time,
        "bound_ns": samples.bound,
        "quality": samples.quality,
    }
    return _rows(samples.time, samples.values, samples.stream.channels, start, units, known)


def frame_rows(frames: Frames, start: int, units: Units = SI, *, known: bool = True) -> pa.RecordBatch:
    """Frames as rows, like ``sample_rows``; ``known`` adds sequence, and quality and bound of each channel."""
    columns: dict[str, Any] = {}
    if known:
        columns["sequence"] = np.arange(frames.sequence, frames.sequence + len(frames))
        for i, name in enumerate(frames.layout.names):
            columns[f"{name}.quality"] = frames.quality[:, i]
            columns[f"{name}.bound_ns"] = frames.bound[:, i]
    return _rows(frames.time, frames.values, frames.layout.channels, start, units, columns)


def _rows(
    time: Any, values: Any, channels: Channels, start: int, units: Units, known: dict[str, Any]
) -> pa.RecordBatch:
    columns = {"t": (time - start) / 1e9, "utc_ns": time}
    columns |= {channel.name: units.of(channel.unit).of(values[:, i]) for i, channel in enumerate(channels)} | known
    names = {channel.name: units.of(channel.unit).name for channel in channels} | _UNITS
    arrays = [c if isinstance(c, pa.Array) else pa.array(np.ascontiguousarray(c)) for c in columns.values()]
    fields = []
    for name, array in zip(columns, arrays, strict=True):
        unit = names.get(name) or ("ns" if name.endswith(".bound_ns") else None)
        fields.append(pa.field(name, array.type, metadata={"unit": unit} if unit else None))
    return pa.record_batch(arrays, schema=pa.schema(fields))


class Table:
    """A table file with columns ``t`` (s since ``start``, UTC ns), ``utc_ns``, one a channel, then bounds and the like.

    Values are in ``units``. The units are named in the columns' metadata (Parquet) or in a JSON file beside the table
    (CSV); a CSV column that is not in the SI unit also has its unit in its heading. Use as a context manager. Raises
    ``RecordingError`` if the file cannot be written.
    """

    def __init__(self, path: Path, channels: Channels, start: int, header: Header, units: Units = SI) -> None:
        self.path = path
        self.rows = 0
        self._channels = channels
        self._start = start
        self._header = header
        self._units = units
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
        self._add(sample_rows(join(batch.source, batch.stream, [batch]), self._start, self._units))

    def add_frames(self, frames: Frames) -> None:
        """Append frames: with sequence, and quality and bound of each channel."""
        self._add(frame_rows(frames, self._start, self._units))

    def _add(self, rows: pa.RecordBatch) -> None:
        self._held.append(rows)
        self.rows += len(rows)
        if sum(map(len, self._held)) >= ROWS:
            self._flush()

    def _flush(self) -> None:
        if not self._held:
            return
        table = pa.Table.from_batches(self._held).combine_chunks()
        self._held = []
        try:
            if self._writer is None:
                self._writer = self._open(table.schema)
            self._writer.write_table(table)
        except UnicodeEncodeError as error:
            raise RecordingError(f"{self.path!r} cannot be written: its name is not UTF-8") from error
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be written: {error}") from error

    def _open(self, schema: Any) -> Any:
        if self.path.suffix == ".csv":
            # pyarrow would quote every name, and simple readers take the quotes as part of the name.
            with self.path.open("w", newline="", encoding="utf-8") as file:
                csv.writer(file, lineterminator="\n").writerow(
                    [self._named.get(name, (name,))[0] for name in schema.names]
                )
            options = pyarrow.csv.WriteOptions(include_header=False)
            out = self._stack.enter_context(self.path.open("ab"))
            return self._stack.enter_context(pyarrow.csv.CSVWriter(out, schema, write_options=options))
        schema = schema.with_metadata({"cellwatt": json.dumps(about(self._header, self._start))})
        return self._stack.enter_context(pyarrow.parquet.ParquetWriter(self.path, schema, compression="zstd"))

    @property
    def _named(self) -> dict[str, tuple[str, str]]:
        """Heading of a CSV file and unit of each channel."""
        out = {}
        for channel in self._channels:
            unit = self._units.of(channel.unit).name
            out[channel.name] = (channel.name if unit == channel.unit else f"{channel.name} [{unit}]", unit)
        return out

    def _describe(self) -> None:
        if self.path.suffix == ".csv" and self._writer is not None:
            units = dict(self._named.values())
            self.path.with_suffix(".json").write_text(
                json.dumps({**about(self._header, self._start), "units": units}, indent=2) + "\n"
            )


def about(header: Header, start: int) -> dict[str, Any]:
    """Origin of a table: site, cell, session and ``start`` (UTC ns) of its recording."""
    return {"site": header.site, "cell": header.cell, "session": header.session, "start_utc_ns": start}


Library = Literal["pandas", "polars", "arrow"]


def data_frame(rows: pa.RecordBatch, header: Header, start: int, library: Library | None) -> Any:
    """A data frame of ``library``; by default of pandas, else polars, else Arrow, whichever is installed.

    Units by column are in ``attrs["units"]`` (pandas) or in the fields' metadata (Arrow); polars has no place for them.
    Raises ``CellwattError`` if ``library`` is not installed.
    """
    library = library or next((name for name in ("pandas", "polars") if find_spec(name)), "arrow")
    table = pa.Table.from_batches([rows]).replace_schema_metadata({"cellwatt": json.dumps(about(header, start))})
    try:
        if library == "pandas":
            frame = table.to_pandas(ignore_metadata=True)
            units = {f.name: f.metadata[b"unit"].decode() for f in table.schema if f.metadata}
            frame.attrs = {**about(header, start), "units": units}
            return frame
        if library == "polars":
            import polars

            return polars.from_arrow(table)
    except ImportError as error:
        raise CellwattError(f"library={library!r} is not installed: pip install {library}") from error
    return table


def of_channels(frames: Frames, wanted: Sequence[str]) -> Frames:
    """Frames restricted to the channels ``wanted`` by name or pattern. Raises ``ConfigError``."""
    layout = frames.layout
    found = [[i for i, c in enumerate(layout.names) if fnmatchcase(c, n)] or [layout.index(n)] for n in wanted]
    columns = [i for each in found for i in each]
    chosen = Layout(tuple(layout.channels[i] for i in columns), layout.rate)
    return replace(
        frames, layout=chosen, **{name: getattr(frames, name)[:, columns] for name in ("values", "quality", "bound")}
    )
