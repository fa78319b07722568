"""Tables as files: CSV, Parquet and recordings of cellwatt are read, CSV and Parquet written.

pyarrow is imported on first use.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError, why
from cellwatt.files import COMPUTED, UnfitFileError, check_file, read_bytes
from cellwatt.tables.table import Table

if TYPE_CHECKING:
    import pyarrow as pa

LARGEST: Final = 4_000_000_000
"""Bytes of a Parquet file in memory; one of some kB may unpack to any number."""
_LONGEST: Final = 40
"""Characters of a cell that a message repeats."""


def read_table(path: Path) -> Table:
    """A Parquet or CSV file, or the frames of a recording, whose time ``t`` counts from its first frame.

    CSV: comma, semicolon, tab or blanks between the columns, decimal commas where another separates them. Raises
    ``RecordingError`` where it cannot be read, has no names or no rows, or a name twice.
    """
    if path.is_dir() or ".mcap" in path.suffixes:
        return _recorded(path)
    import pyarrow as pa

    try:
        table, text = (_parquet(path), None) if path.suffix == ".parquet" else _csv(path)
        return _table(path, table, text)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {_line(why(error))}") from error
    except (pa.ArrowException, ValueError) as error:  # the latter: names that are not UTF-8
        raise RecordingError(f"{path}: cannot be read as a table: {_line(error)}") from error


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """Write columns as Parquet, or CSV where the name says so. Raises ``RecordingError`` where that cannot be."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write = pyarrow.csv.write_csv if path.suffix == ".csv" else pyarrow.parquet.write_table
        write(pa.table(dict(columns)), path)
    except OSError as error:
        raise RecordingError(f"{path} cannot be written: {why(error).lower()}") from error


def _recorded(path: Path) -> Table:
    from cellwatt.record import Recording

    frames = Recording.open(path).frames_table()
    columns = {name: np.ascontiguousarray(frames.values[:, i]) for i, name in enumerate(frames.layout.names)}
    units = {channel.name: channel.unit for channel in frames.layout.channels}
    return Table(path, {"t": (frames.time - frames.time[0]) * 1e-9, **columns}, units=units)


def _parquet(path: Path) -> pa.Table:
    import pyarrow.parquet as pq

    check_file(path, COMPUTED)
    about = pq.read_metadata(path)
    packed = sum(about.row_group(i).total_byte_size for i in range(about.num_row_groups))
    if max(8 * about.num_rows * about.num_columns, packed) > LARGEST:
        raise UnfitFileError(f"would take more than {LARGEST:,} bytes of memory")
    return pq.read_table(path)


def _csv(path: Path) -> tuple[pa.Table, bytes]:
    import pyarrow as pa
    import pyarrow.csv

    content = read_bytes(path, COMPUTED).removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    header, _, rest = content.partition(b"\n")
    separator = next((s for s in (b";", b",", b"\t") if s in header), b" ")
    if separator == b" ":
        content = re.sub(rb"(?m)^ +| +$", b"", re.sub(rb" {2,}", b" ", content))
    decimal = "," if separator != b"," and b"," in rest.partition(b"\n")[0] else "."
    try:
        table = pyarrow.csv.read_csv(
            io.BytesIO(content),
            # One block: types are told by the whole file, not by its beginning.
            read_options=pyarrow.csv.ReadOptions(block_size=max(len(content), 1)),
            parse_options=pyarrow.csv.ParseOptions(delimiter=separator.decode()),
            convert_options=pyarrow.csv.ConvertOptions(decimal_point=decimal),
        )
    except pa.ArrowInvalid as error:
        raise ValueError(_ragged(content, separator) or str(error)) from error
    return table, content


def _ragged(content: bytes, separator: bytes) -> str:
    """The first line with more or fewer cells than the header, in words."""
    header, *lines = content.split(b"\n")
    expected = header.count(separator) + 1
    for number, line in enumerate(lines, start=2):
        if line and (cells := line.count(separator) + 1) != expected:
            return f"line {number} has {cells} cells, expected {expected} as in the header"
    return ""


def _table(path: Path, table: pa.Table, content: bytes | None) -> Table:
    names = [name.strip() for name in table.column_names]
    if all(_is_number(name) for name in names if name):
        raise RecordingError(f"{path}: no names in its first row: write t, q_1, …, tau_1, … above the columns")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: two columns are called {twice!r}")
    if not table.num_rows:
        raise RecordingError(f"{path}: has no rows")
    columns: dict[str, NDArray[np.float64]] = {}
    text: dict[str, str] = {}
    for name, column in zip(names, table.columns, strict=True):
        if (numbers := _numbers(column)) is None:
            text[name] = _first_word(column, content)
        else:
            columns[name] = numbers
    units = {name: (field.metadata or {}).get(b"unit", b"") for name, field in zip(names, table.schema, strict=True)}
    return Table(path, columns, text, {name: unit.decode() for name, unit in units.items() if unit})


def _numbers(column: Any) -> NDArray[np.float64] | None:
    """A column as float64, times of day as s; None where it holds no numbers."""
    import pyarrow as pa

    kind, scale = column.type, 1.0
    if pa.types.is_timestamp(kind):
        column, scale = column.cast(pa.timestamp("ns")).cast(pa.int64()), 1e-9
    elif not any(of(kind) for of in (pa.types.is_floating, pa.types.is_integer, pa.types.is_null, pa.types.is_boolean)):
        return None
    # Unsafe: counters of ns beyond 2⁵³ lose their last digits.
    return scale * np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), np.float64)


def _first_word(column: Any, content: bytes | None) -> str:
    """Place and content of the first cell in a column of text that is no number."""
    words = ((row, str(cell.as_py())) for row, cell in enumerate(column) if cell.is_valid)
    row, word = next(((row, word) for row, word in words if not _is_number(word)), (0, str(column.type)))
    place = f"row {row + 1}"
    if content is not None:
        filled = (number for number, line in enumerate(content.split(b"\n"), start=1) if line)  # others are no rows
        place = f"line {next(islice(filled, row + 1, None))}"
    return f"first {word[:_LONGEST]!r} in {place}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _line(error: object) -> str:
    return str(error).strip().splitlines()[0][:120]
