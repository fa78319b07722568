"""Tables as files: CSV, Parquet and recordings of cellwatt are read, CSV and Parquet written.

pyarrow is imported on first use.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError, why
from cellwatt.files import COMPUTED, UnfitFileError, check_file, read_bytes
from cellwatt.tables.by_name import by_name, label_of, names_joints
from cellwatt.tables.cells import TEXT, Cells, cells_of, grouped, listed
from cellwatt.tables.encoding import text_of
from cellwatt.tables.fractions import joined
from cellwatt.tables.names import is_unit, scale, understood
from cellwatt.tables.rows import NUMBER, Rows, cells_in, rows_of
from cellwatt.tables.table import Table
from cellwatt.tables.times import CLOCKS, DAY

if TYPE_CHECKING:
    import pyarrow as pa

log = logging.getLogger(__name__)

LARGEST: Final = 4_000_000_000
"""Largest size of a Parquet file in memory in bytes; a file of some kB may unpack to any size."""
LARGEST_TEXT: Final = 1_000_000_000
"""Largest size of the texts of a Parquet file in memory in bytes."""
MOST_COLUMNS: Final = 5_000
"""Largest number of columns of a table; a file of some kB may claim any number."""
_HEAD: Final = 3
"""Largest number of rows between the names and the first numbers that may hold units."""
_LONGEST: Final = 40
"""Largest number of characters of a cell that a message quotes."""


def read_table(path: Path, joints: Sequence[str] = ()) -> Table:
    """Read a Parquet or CSV file, the frames of a recording (``t`` from the first frame), or a log of other programs.

    ``joints`` are the robot's joint names in order, by which the columns of a log with named joints are ordered.

    CSV: any separator, decimal mark and encoding that spreadsheets and loggers write. A column that cannot be read is
    refused when it is used. Raises ``RecordingError`` if the file cannot be read, or has no names or no rows.
    """
    from cellwatt.logs.opening import is_log, read_log

    if is_log(path):
        log_of = read_log(path)
        return Table(path, {"t": log_of.time, **log_of.columns(joints)}, named=tuple(joints) or log_of.joints)
    if not is_table(path):
        return _recorded(path)
    import pyarrow as pa

    try:
        return _once(by_name(_arrow(path, _parquet(path)) if path.suffix == ".parquet" else _csv(path), joints))
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {_line(why(error))}") from error
    except (pa.ArrowException, ValueError) as error:  # ValueError: names that are not UTF-8
        raise RecordingError(f"{path}: cannot be read as a table: {_line(error)}") from error


def is_table(path: Path) -> bool:
    """True unless the path is a recording of cellwatt, a folder or a bag: CSV, Parquet, or another text."""
    return not path.is_dir() and ".mcap" not in path.suffixes and path.suffix != ".db3"


def write_table(path: Path, columns: Mapping[str, Any]) -> None:
    """Write columns as CSV if the name ends in ``.csv``, otherwise as Parquet. Raises ``RecordingError``."""
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
    _check_columns(about.num_columns)
    columns = [about.schema.column(i) for i in range(about.num_columns)]
    # A dictionary holds each text once, as the file does; then the number of its occurrences is known.
    texts = [c.path for c in columns if c.physical_type == "BYTE_ARRAY" and not c.max_repetition_level]
    with pq.ParquetFile(path, read_dictionary=texts) as file:
        return _without_dictionaries(_flat(file.read()))


def _check_columns(number: int) -> None:
    if number > MOST_COLUMNS:
        raise UnfitFileError(f"has {number:,} columns; {MOST_COLUMNS:,} are the most")


def _without_dictionaries(table: pa.Table) -> pa.Table:
    """Replace dictionary columns by plain texts. Raises ``UnfitFileError`` if these would fill the memory."""
    import pyarrow as pa
    import pyarrow.compute as pc

    size = 0
    for index, column in enumerate(table.columns):
        if not pa.types.is_dictionary(column.type):
            continue
        for chunk in column.chunks:
            lengths = pc.binary_length(chunk.dictionary).take(chunk.indices)
            size += pc.sum(lengths).as_py() or 0
        if size > LARGEST_TEXT:
            raise UnfitFileError(f"has more than {LARGEST_TEXT:,} bytes of text")
        field = table.schema.field(index).with_type(column.type.value_type)
        table = table.set_column(index, field, column.cast(field.type))
    return table


def _csv(path: Path) -> Table:
    """Read a text table. Raises ``ValueError`` if it is none."""
    import pyarrow as pa
    import pyarrow.csv

    rows = rows_of(text_of(read_bytes(path, COMPUTED)))
    _check_columns(len(rows.names))
    if rows.torn:
        log.warning("%s: ends within row %d, which is left out", path, rows.torn)
    units, records, numbers = _units(rows)
    if not records:
        raise RecordingError(f"{path}: has no rows")
    content = "\n".join(records).encode()
    names = [str(i) for i in range(len(rows.names))]
    columns = pyarrow.csv.read_csv(
        io.BytesIO(content),
        read_options=pyarrow.csv.ReadOptions(block_size=len(content) + 1, column_names=names),
        parse_options=pyarrow.csv.ParseOptions(delimiter=rows.separator),
        convert_options=pyarrow.csv.ConvertOptions(
            column_types=dict.fromkeys(names, pa.string()), strings_can_be_null=True, null_values=["", "nan", "NaN"]
        ),
    )
    if columns.num_rows != len(records):
        raise ValueError(f"it has {len(records)} rows, but {columns.num_rows} were found: check its quotes")
    names, texts = listed(rows.names, columns.columns)
    found = [cells_of(pa.chunked_array(column), rows.separator) for column in texts]
    found = [_agreed(cells, name, units.get(name)) for name, cells in zip(names, found, strict=True)]
    units = {**{name: cells.unit for name, cells in zip(names, found, strict=True) if cells.unit}, **units}
    return _placed(path, names, texts, _without_groups(found, texts), units, numbers)


def _units(rows: Rows) -> tuple[Mapping[str, str], Sequence[str], Sequence[int]]:
    """Units in a row below the names, and the rows after it with their numbers; descriptions may stand between.

    The known names have units there, or all names if none is known.
    """
    for end, record in enumerate(rows.records[:_HEAD], start=1):
        cells = cells_in(record, rows.separator)
        if any(map(NUMBER.fullmatch, cells)):
            break
        found = {name: cell.strip(" \t[]()") for name, cell in zip(rows.names, cells, strict=False) if name}
        written = {name: unit for name, unit in found.items() if unit and unit != "-"}
        known = [unit for name, unit in written.items() if understood(name) is not None] or list(written.values())
        if known and all(map(is_unit, known)):
            head = rows.records[:end]  # loggers may append it again
            below = [i for i, each in enumerate(rows.records) if each not in head]
            return written, [rows.records[i] for i in below], [rows.numbers[i] for i in below]
    return {}, rows.records, rows.numbers


def _agreed(cells: Cells, name: str, stated: str | None) -> Cells:
    """Refuse a column whose numbers are followed by another unit than its name, or the row below it, says."""
    known = understood(name) if cells.unit else None
    if known is None or (unit := known.unit or stated) is None:
        return cells
    same = scale(known.quantity, unit) == scale(known.quantity, cells.unit)
    return cells if same else Cells(None, fault=f"has values in {cells.unit}, while its unit is {unit}")


def _without_groups(found: Sequence[Cells], columns: Sequence[Any]) -> Sequence[Cells]:
    """Refuse columns with numbers like 1.234 beside columns with decimal commas: the point may group thousands."""
    if not any(cells.commas for cells in found):
        return found
    fault = "may have decimal points or digits in groups of three, as other columns have decimal commas"
    plain = [cells.values is not None and cells.kind is None and not cells.commas for cells in found]
    rows = [grouped(column) if each else None for each, column in zip(plain, columns, strict=True)]
    return [cells if row is None else Cells(None, row=row, fault=fault) for cells, row in zip(found, rows, strict=True)]


def _placed(
    path: Path,
    written: Sequence[str],
    columns: Sequence[Any],
    found: Sequence[Cells],
    units: Mapping[str, str],
    numbers: Sequence[int] | None = None,
) -> Table:
    """Make a table of the named columns, without rows that lack a time; ``numbers``: row numbers in a text file."""
    values: dict[str, NDArray[np.float64]] = {}
    unfit: dict[str, str] = {}
    labels: dict[str, str] = {}
    index = "" if "time" in written else "time"  # pandas writes the times of an index without a name
    names = [name or (index if cells.kind in CLOCKS else "") for name, cells in zip(written, found, strict=True)]
    names = _counted(names)
    letters = {} if numbers is None else dict(zip(names, map(letters_of, range(len(names))), strict=True))
    clocks = tuple(name for name, cells in zip(names, found, strict=True) if name and cells.kind in CLOCKS)
    table = Table(path, values, unfit, units, None if numbers is None else np.asarray(numbers), letters, clocks)
    dates = [cells.values for cells in found if cells.kind == "date" and cells.values is not None]
    for name, cells, column in zip(names, found, columns, strict=True):
        if name and names.count(name) > 1:
            positions = [letters_of(k) for k, other in enumerate(names) if other == name]
            unfit[name] = f"is there {len(positions)} times, as columns {', '.join(positions)}: keep one"
        elif name and cells.values is not None:
            day = dates[0] if cells.kind == "clock" and len(dates) == 1 else 0.0
            values[name] = cells.values % DAY + day if np.ndim(day) else cells.values
        elif name:
            word = str(column[cells.row])[:_LONGEST]
            wanted = ", expected numbers" if cells.fault == TEXT else ""
            unfit[name] = f"{cells.fault}, first {word!r} in {table.place(name, cells.row)}{wanted}"
            if names_joints(name) and cells.fault == TEXT:
                labels[name] = label_of(column)
    return _timed(replace(table, clocks=joined(values, clocks), labels=labels))


def _counted(names: Sequence[str]) -> list[str]:
    """Number a joint's quantity whose name stands above several columns, as ``q, q, q`` or pandas' ``q, q.1, q.2``."""

    def repeated(name: str) -> bool:
        of_joint = understood(name) is None and (known := understood(f"{name}.1")) is not None and known.number == 1
        again = names.count(name) > 1 or (f"{name}.1" in names and f"{name}.0" not in names)
        return of_joint and again

    return [f"{name}.{names[:i].count(name)}" if repeated(name) else name for i, name in enumerate(names)]


def _timed(table: Table) -> Table:
    """The rows that have a time, the earliest first. A table without times is returned unchanged."""
    if (clock := table.clock) is None or clock not in table.columns:
        return table
    table = _without(table, ~np.isfinite(table.columns[clock]), "have no time")
    time = table.columns[clock]
    if len(time) < 2 or not time[-1] < time[0] or np.any(np.diff(time) > 0):
        return table
    log.warning("%s: its times fall from row to row: it is read from the last row to the first", table.path)
    return table.at(slice(None, None, -1))


def _once(table: Table) -> Table:
    """The rows that differ from the row before: a program may read faster than new values come.

    A table without times is returned unchanged.
    """
    if table.clock is None or table.clock not in table.columns or len(table) < 2:
        return table
    same = np.diff(table.columns[table.clock], prepend=np.nan) == 0
    for values in table.columns.values() if same.any() else ():
        same[1:] &= (values[1:] == values[:-1]) | ~np.isfinite(values[1:])
    return _without(table, same, "repeat the row before")


def _without(table: Table, rows: NDArray[np.bool_], why: str) -> Table:
    """The table without ``rows`` (N,), which a warning counts; unchanged if these are all rows."""
    if rows.all() or not rows.any():
        return table
    counts = (table.path, np.sum(rows), len(rows), why, table.row(int(np.argmax(rows))))
    log.warning("%s: %d of %d rows %s and are left out, first row %d", *counts)
    return table.at(~rows)


def letters_of(column: int) -> str:
    """Letters of a column in a spreadsheet: A, B, …, Z, AA; ``column`` counts from 0."""
    before = letters_of(column // 26 - 1) if column >= 26 else ""
    return before + chr(ord("A") + column % 26)


def _arrow(path: Path, table: pa.Table) -> Table:
    """Make a table of the columns of a Parquet file."""
    names = [name.strip() for name in table.column_names]
    if not table.num_rows:
        raise RecordingError(f"{path}: has no rows")
    units = {name: (field.metadata or {}).get(b"unit", b"") for name, field in zip(names, table.schema, strict=True)}
    stated = {name: unit.decode() for name, unit in units.items() if unit}
    return _placed(
        path,
        names,
        table.columns,
        [_typed(name, column) for name, column in zip(names, table.columns, strict=True)],
        stated,
    )


def _flat(table: pa.Table) -> pa.Table:
    """Replace fields and lists of one length by columns: ``joint.speed``, ``position[0]``, ``position[1]`` …"""
    import pyarrow as pa

    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    fields: list[pa.Field[Any]] = []
    columns: list[Any] = []
    for field, column in zip(table.schema, table.columns, strict=True):
        width = _width(column)
        _check_columns(len(fields) + width)
        values: Any = column.combine_chunks().flatten() if width else column
        fields += [field.with_name(f"{field.name}[{i}]").with_type(values.type) for i in range(width)] or [field]
        columns += [values[i::width] for i in range(width)] or [values]
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def _width(column: Any) -> int:
    """Length of the lists of numbers of a column; 0 if it has none, or of different lengths."""
    import pyarrow.compute as pc

    lists = _is(column.type, "list", "large_list", "fixed_size_list")
    if not lists or not _is(column.type.value_type, "floating", "integer", "decimal", "string", "large_string"):
        return 0
    lengths = pc.min_max(pc.list_value_length(column)).as_py()
    return lengths["min"] if lengths["min"] == lengths["max"] and not column.null_count and len(column) else 0


def _is(kind: Any, *names: str) -> bool:
    """True for one of the types of Arrow with these names."""
    import pyarrow as pa

    return any(getattr(pa.types, f"is_{name}")(kind) for name in names)


def _typed(name: str, column: Any) -> Cells:
    """Content of a typed column; texts are read like those of a text table."""
    import pyarrow as pa

    kind = column.type
    if (moments := _is(kind, "timestamp")) or _is(kind, "duration"):
        unit = pa.timestamp("ns") if moments else pa.duration("ns")
        ns = column.cast(unit).cast(pa.int64()).cast(pa.float64(), safe=False)
        return Cells(1e-9 * np.asarray(ns.to_numpy(), np.float64), "moment" if moments else None)
    if _is(kind, "string", "large_string"):
        return Cells(None, fault=TEXT) if names_joints(name) else cells_of(column.cast(pa.string()), "")
    if pa.types.is_nested(kind):
        return Cells(None, fault="holds lists of text, or of different lengths")
    if not _is(kind, "floating", "integer", "null", "boolean", "decimal"):
        return Cells(None, fault=TEXT)
    # Unsafe: counters of ns beyond 2⁵³ lose their last digits.
    return Cells(np.asarray(column.cast(pa.float64(), safe=False).to_numpy(), np.float64))


def _line(error: object) -> str:
    return str(error).strip().splitlines()[0][:160]
