"""Files as tables: Parquet, CSV and cellwatt's own recordings."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from cellwatt.errors import RecordingError, why
from cellwatt.files import COMPUTED, read_bytes
from cellwatt.parquet import read_parquet
from cellwatt.record import Recording
from cellwatt_plugins.mismatch.input.columns import CLOCKS, listed

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """A file's columns as they stand in it, NaN where a cell is empty."""

    place: str
    """What messages call it: the file's name."""
    time: Float
    """(N,) s."""
    columns: Mapping[str, Float]
    """(N,) each."""
    text: Mapping[str, str] = field(default_factory=dict)
    """Columns that hold something else than numbers, and the first such cell of each."""

    def names(self) -> list[str]:
        """All columns beside the time."""
        return [*self.columns, *self.text]

    def values(self, name: str) -> Float:
        """One column (N,). Raises ``RecordingError`` where it holds text."""
        if name in self.text:
            raise RecordingError(f"{self.place}: column {name} holds text, first {self.text[name]!r}, not numbers")
        return self.columns[name]


def read_table(path: Path) -> Table:
    """Read a file, or a folder of cellwatt recordings. Raises ``RecordingError``."""
    if path.is_dir() or ".mcap" in path.suffixes:
        return _recorded(path)
    try:
        table = read_parquet(path) if path.suffix == ".parquet" else _csv(path)
        return _converted(path, table)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {_line(why(error))}") from error
    except (pa.ArrowException, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read as a table: {_line(error)}") from error


def _recorded(path: Path) -> Table:
    """The frames of a recording; time counts from its first frame."""
    frames = Recording.open(path).frames_table()
    columns = {name: np.ascontiguousarray(frames.values[:, i]) for i, name in enumerate(frames.layout.names)}
    return Table(path.name, (frames.time - frames.time[0]) / 1e9, columns)


def _csv(path: Path) -> Any:
    """Comma, semicolon, tab or blanks between the columns; decimal commas where the separator is another."""
    content = read_bytes(path, COMPUTED).removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    header, _, rest = content.partition(b"\n")
    separator = next((s for s in (";", ",", "\t") if s.encode() in header), " ")
    if separator == " ":
        content = re.sub(rb"(?m)^ +| +$", b"", re.sub(rb" {2,}", b" ", content))
    decimal = "," if separator != "," and b"," in rest.partition(b"\n")[0] else "."
    return pyarrow.csv.read_csv(
        io.BytesIO(content),
        parse_options=pyarrow.csv.ParseOptions(delimiter=separator),
        convert_options=pyarrow.csv.ConvertOptions(decimal_point=decimal),
    )


def _converted(path: Path, table: Any) -> Table:
    names = [name.strip() for name in table.column_names]
    if all(_number(name) for name in names if name):
        raise RecordingError(f"{path}: no names in its first row: write t, q_1, …, tau_1, … above the columns")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: two columns are called {twice!r}")
    columns: dict[str, Float] = {}
    text: dict[str, str] = {}
    for name, column in zip(names, table.columns, strict=True):
        if (numbers := _numbers(column)) is None:
            text[name] = _first_word(column)
        else:
            columns[name] = numbers
    clock = next((name for name in CLOCKS if name in names), None)
    if clock is None:
        raise RecordingError(f"{path}: no column {', '.join(CLOCKS)} for the time; there are: {listed(names)}")
    found = Table(path.name, columns.get(clock, np.empty(0)), columns, text)
    time = found.values(clock)
    return Table(path.name, time, {name: values for name, values in columns.items() if name != clock}, text)


def _numbers(column: Any) -> Float | None:
    """A column as float64, times of day as s; None where it holds no numbers."""
    kind, scale = column.type, 1.0
    if pa.types.is_timestamp(kind):
        column, scale = column.cast(pa.timestamp("ns")).cast(pa.int64()), 1e-9
    elif not any(of(kind) for of in (pa.types.is_floating, pa.types.is_integer, pa.types.is_null, pa.types.is_boolean)):
        return None
    # Unsafe: counters of ns beyond 2⁵³ lose their last digits.
    return scale * np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), np.float64)


def _first_word(column: Any) -> str:
    cells = (str(cell) for cell in column.to_pylist() if cell is not None)
    return next((cell for cell in cells if not _number(cell)), str(column.type))[:40]


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _line(error: object) -> str:
    return str(error).strip().splitlines()[0][:120]
