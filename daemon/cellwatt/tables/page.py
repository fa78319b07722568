"""The page of ``cellwatt plot`` for tables: every numeric column over time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt.report import Axis, Notes, Panel, Provenance, Report, Section, over_time
from cellwatt.report.drawing import curve
from cellwatt.report.figure import Json
from cellwatt.report.theme import SERIES
from cellwatt.tables.files import read_table
from cellwatt.tables.table import Table, listed

MOST: Final = 24
"""Largest number of diagrams of a table."""
FINEST: Final = 4
"""Largest number of grid steps per row: uneven rows are drawn within a quarter of their mean distance."""
_UNIT: Final = re.compile(r"\s*[\[(]\D.*$")
_NUMBER: Final = re.compile(r"[\s_.\[]*\d+\]?(?=\D*$)")


def report(paths: Sequence[Path], start: float | None, end: float | None, wanted: Sequence[str]) -> Report:
    """Make the page of tables; ``start`` and ``end`` s from the first row, ``wanted`` parts of column names.

    Raises ``RecordingError`` if a file is not a table, or has nothing to draw.
    """
    tables = [read_table(path) for path in paths]
    sections = [section for table in tables for section in _sections(table, start, end, wanted)]
    verdict = f"{sum(map(len, tables)):,} rows were read."
    origin = Provenance.here(paths)
    return Report(", ".join(path.name for path in paths), "table", [], verdict, sections, provenance=origin)


def _sections(table: Table, start: float | None, end: float | None, wanted: Sequence[str]) -> list[Section]:
    x, time = _time(table)
    shown = (x >= (-np.inf if start is None else start - 1e-9)) & (x <= (np.inf if end is None else end + 1e-9))
    groups = _groups(table, wanted)
    if not groups or not shown.any():
        raise RecordingError(f"{table.path}: no such columns, or no rows in that span; {table.there()}")
    first, last = float(x[shown][0]), float(x[shown][-1])
    axis = Axis(time, (first, last))
    rows = [
        [Panel([_curve(table, name, x, shown, n) for n, name in enumerate(names)], axis, title=title)]
        for title, names in list(groups.items())[:MOST]
    ]
    left_out = [f"column {name} {why}" for name, why in table.unfit.items()]
    if more := [name for names in list(groups.values())[MOST:] for name in names]:
        left_out.append(f"{len(more)} further columns, to be chosen with --channel: {listed(more)}")
    return [
        Section(table.path.name, [over_time(f"Columns of {table.path.name} over time", rows)]),
        Section("Not drawn", [Notes(left_out)] if left_out else []),
    ]


def _time(table: Table) -> tuple[NDArray[np.float64], str]:
    """Position of each row (N,) along the axis, and the axis's title: row numbers without a rising time."""
    if table.clock is not None and table.clock not in table.unfit:
        time = table.time - table.time[0]
        if len(time) > 1 and np.all(np.diff(time) > 0):
            return time, "s since the first row"
    return np.arange(len(table), dtype=np.float64), "row"


def _groups(table: Table, wanted: Sequence[str]) -> Mapping[str, list[str]]:
    """Columns of each diagram by title: names that differ only in their last number."""
    groups: dict[str, list[str]] = {}
    for name in table.columns:
        if name == table.clock or (wanted and not any(part in name for part in wanted)):
            continue
        written = _UNIT.search(name)
        unit = f" [{table.units[name]}]" if name in table.units else written[0] if written else ""
        groups.setdefault(_NUMBER.sub("", _UNIT.sub("", name)) + unit, []).append(name)
    return {title if len(names) > 1 else names[0]: names for title, names in groups.items()}


def _curve(table: Table, name: str, x: NDArray[np.float64], shown: NDArray[np.bool_], number: int) -> Json:
    """A column as a curve on an even grid, with gaps where rows are missing."""
    at, values = x[shown], table.columns[name][shown]
    step = float(np.median(np.diff(at))) if len(at) > 1 else 1.0
    step = max(step, (at[-1] - at[0]) / (FINEST * len(at)))
    positions = np.round((at - at[0]) / step).astype(np.int64)
    grid = np.full(int(positions[-1]) + 1, np.nan)
    grid[positions] = values
    return curve(name, grid, SERIES[number % len(SERIES)], start=float(at[0]), step=step)
