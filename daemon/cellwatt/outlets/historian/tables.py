"""Rows and results as Parquet tables. Pure. pyarrow is imported here: only the process that writes a lake needs it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

import pyarrow as pa
import pyarrow.parquet as pq
import pydantic_core

from cellwatt.channel import Quality
from cellwatt.outlets.past import Archived
from cellwatt.outlets.selection import Row
from cellwatt.version import __version__

_TIME: Final = pa.timestamp("ns", tz="UTC")
_SCHEMAS: Final = {
    "alarms": (
        ("time", _TIME), ("session", pa.int64()), ("id", pa.string()), ("kind", pa.string()),
        ("severity", pa.string()), ("active", pa.bool_()), ("since", _TIME), ("statement", pa.string()),
        ("source", pa.string()), ("joint", pa.int64()), ("stage", pa.string()), ("evidence", pa.string()),
    ),
    "tasks": (
        ("time", _TIME), ("session", pa.int64()), ("start", _TIME), ("source", pa.string()), ("task", pa.string()),
        ("signature", pa.string()), ("variant", pa.string()), ("speed", pa.float64()), ("repetition", pa.int64()),
    ),
    "energies": (
        ("time", _TIME), ("session", pa.int64()), ("start", _TIME), ("source", pa.string()), ("task", pa.string()),
        ("variant", pa.string()), ("repetition", pa.int64()), ("total", pa.float64()),
        ("uncertainty", pa.float64()), ("positive_mechanical", pa.float64()),
        ("motion_efficiency_percent", pa.float64()), ("groups", pa.map_(pa.string(), pa.float64())),
    ),
}  # fmt: skip
_FIELDS: Final = {("tasks", "time"): "end", ("tasks", "task"): "name", ("energies", "time"): "end"}
"""Fields of results whose columns are called otherwise."""


def frame_table(rows: Sequence[Row], units: Mapping[str, str], session: int) -> pa.Table:
    """Rows as columns ``time``, ``session``, ``sequence``, ``quality`` and one a channel; missing values are null.

    ``quality`` is the worst of the values that are there.
    """
    columns: dict[str, Any] = {
        "time": pa.array([row.time for row in rows], _TIME),
        "session": pa.array([session] * len(rows), pa.int64()),
        "sequence": pa.array([row.sequence for row in rows], pa.int64()),
        "quality": pa.array([_worst(row) for row in rows], pa.uint8()),
    }
    fields = [pa.field(name, array.type) for name, array in columns.items()]
    for name, unit in units.items():
        columns[name] = pa.array([row.values.get(name) for row in rows], pa.float64())
        fields.append(pa.field(name, pa.float64(), metadata={"unit": unit}))
    return pa.table(list(columns.values()), schema=pa.schema(fields))


def result_table(name: str, results: Sequence[Archived], session: int) -> pa.Table:
    """Results of one kind as the table ``name``: alarms, tasks or energies."""
    columns = [column for column, _ in _SCHEMAS[name] if column != "session"]
    plain = [{"session": session, **{c: _cell(name, c, result) for c in columns}} for result in results]
    schema = pa.schema([pa.field(column, kind) for column, kind in _SCHEMAS[name]])
    return pa.Table.from_pylist(plain, schema=schema)


def parquet(table: pa.Table, about: Mapping[str, Any]) -> bytes:
    """A table as a Parquet file; ``about`` is put into its metadata under ``cellwatt``."""
    told = json.dumps({**about, "version": __version__})
    out = pa.BufferOutputStream()
    pq.write_table(table.replace_schema_metadata({"cellwatt": told}), out, compression="zstd")
    content: bytes = out.getvalue().to_pybytes()
    return content


def merged(files: Sequence[bytes]) -> list[tuple[list[int], pa.Table]]:
    """Tables of the same columns and units joined, each with the numbers of its files; the first names the metadata."""
    groups: list[tuple[list[int], list[pa.Table]]] = []
    for number, content in enumerate(files):
        table = pq.read_table(pa.BufferReader(content))
        for numbers, tables in groups:
            if tables[0].schema.equals(table.schema, check_metadata=False) and _units(tables[0]) == _units(table):
                numbers.append(number)
                tables.append(table)
                break
        else:
            groups.append(([number], [table]))
    return [(numbers, pa.concat_tables([t.replace_schema_metadata(None) for t in ts])) for numbers, ts in groups]


def _units(table: pa.Table) -> list[Any]:
    return [(field.metadata or {}).get(b"unit") for field in table.schema]


def _worst(row: Row) -> int:
    there = (quality for name, quality in row.quality.items() if name in row.values)
    return max(there, default=int(Quality.MISSING))


def _cell(table: str, column: str, result: Archived) -> Any:
    value = getattr(result, _FIELDS.get((table, column), column))
    if column == "evidence":
        return pydantic_core.to_json(dict(value), inf_nan_mode="null", fallback=str).decode()
    return list(value.items()) if column == "groups" else value
