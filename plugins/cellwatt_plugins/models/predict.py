"""A model file run on a table: the same network, inputs and windows as the live stage."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.files import Place
from cellwatt.progress import stage
from cellwatt.tables import Table, read_table, write_table
from cellwatt_plugins.models.metadata import SAME_RATE, Metadata
from cellwatt_plugins.models.network import Network
from cellwatt_plugins.models.outside import OUTSIDE, Limits
from cellwatt_plugins.models.window import whole
from cellwatt_plugins.onnx_file import refused

COPIED: Final = ("pose", "move")
"""Columns that number the rows; they are copied into the output, after the time."""
HOLE = 1.5
"""Steps between two rows above which they are not in one window."""
_APPROACH = re.compile(r"(joint_\d+)\.approach")
AT_ONCE = 20_000
"""Number of rows whose windows are in memory together."""


@dataclass(frozen=True)
class Report:
    """Result of a prediction."""

    columns: Mapping[str, NDArray[Any]]
    """Time t (s), pose and move if the table has them, then each output of the model, (N,) each."""
    file: str | None
    """None if no file was written."""
    rows: int
    outputs: tuple[str, ...]
    begun: int
    """Number of rows at the start of a motion, whose windows are filled with the first row: the arm rested there."""
    missing: int
    """Number of rows without a prediction, because an input is missing."""
    outside: Mapping[str, int]
    """Number of rows in which an input is outside its range in training, by channel."""

    def as_json(self) -> dict[str, Any]:
        """Return the report as ``--json`` prints it, without the columns."""
        return {name: value for name, value in vars(self).items() if name != "columns"}

    def in_words(self) -> str:
        """Return the report as text."""
        where = "" if self.file is None else f"written to {self.file}: "
        lines = [f"{where}{self.rows} rows of {', '.join(self.outputs)}"]
        if self.begun:
            lines.append(
                f"{self.begun} rows at the start of a motion were predicted as if the arm had been at rest before"
            )
        if self.missing:
            lines.append(f"{self.missing} rows have no prediction: an input is missing")
        lines += [
            f"warning: {channel} is outside the range of the training in {rows} rows: extrapolated"
            for channel, rows in self.outside.items()
        ]
        return "\n".join(lines)


def predict_file(model: Place, table: Place, out: Place | None = None) -> Report:
    """Run a model file on the rows of a table, or of a recording: the function behind ``cw.predict``.

    ``columns`` of the result holds the outputs, which are also written to ``out`` (.parquet or .csv). The window of a
    model that sees several rows at once starts again where move changes or t jumps. Raises ``ModelError`` if the model
    cannot be run, ``RecordingError`` if the table cannot be used or ``out`` cannot be written.
    """
    file, source = Path(model), Path(table)
    if out is not None and Path(out).resolve() == source.resolve():
        raise RecordingError(f"{source} would be overwritten by its own predictions: choose another --out")
    network = Network(file)
    with stage("reading"):
        rows = read_table(source, network.metadata.joints)
    values = inputs_of(network.metadata, rows)
    starts = starts_of(rows) if network.metadata.window > 1 else np.arange(len(rows)) == 0
    if network.metadata.rate_hz is not None:
        _check_rate(network.metadata.rate_hz, rows, starts, file)
    with stage("running the model"):
        given = predict(network, values, starts)
    names = tuple(output.name for output in network.metadata.outputs)
    copied = {name: _numbered(rows.columns[name]) for name in COPIED if name in rows.columns}
    clock = {} if rows.clock is None else {"t": rows.time}
    columns = {**clock, **copied, **dict(zip(names, given.T, strict=True))}
    if out is not None:
        write_table(Path(out), columns)
    return Report(
        columns,
        None if out is None else str(out),
        len(values),
        names,
        begun=int(np.sum(_since(starts) < network.metadata.window - 1 - network.metadata.delay)),
        missing=int(np.sum(np.isnan(given).all(axis=1))),
        outside=_outside(network.metadata, values),
    )


def inputs_of(metadata: Metadata, table: Table) -> Float:
    """Inputs (N, inputs) of the model from a table's columns, NaN for optional inputs that the table does not have.

    ``joint_i.approach`` is ``q_i`` minus ``q_from_i``, the position that the arm came from. Raises ``RecordingError``
    naming the column that is missing.
    """
    out = np.full((len(table), len(metadata.inputs)), np.nan)
    for i, wanted in enumerate(metadata.inputs):
        found = table.channel(wanted.channel)
        if found is None and (match := _APPROACH.fullmatch(wanted.channel)):
            here, before = (table.channel(f"{match[1]}.{quantity}") for quantity in ("position", "came_from"))
            found = None if here is None or before is None else here - before
        if found is not None:
            out[:, i] = found
        elif not wanted.optional:
            raise RecordingError(
                f"{table.path}: no column for input {i + 1} of {len(metadata.inputs)} of the model, "
                f"{wanted.channel!r} in {wanted.unit}; {table.there()}"
            )
    return out


def starts_of(table: Table, hole: float = HOLE) -> NDArray[np.bool_]:
    """(N,) true where a motion begins: first row, a new ``move``, or a jump of time by more than ``hole`` steps.

    Raises ``RecordingError`` if ``move`` is no number.
    """
    starts = np.zeros(len(table), dtype=bool)
    starts[:1] = True
    move = table.channel("move") if "move" in table.names else None
    if move is not None:
        starts[1:] |= np.diff(move) != 0
    if table.clock is not None and len(table) > 1:
        steps = np.diff(table.time)
        rising = steps[steps > 0]
        starts[1:] |= (steps <= 0) | (steps > hole * (np.median(rising) if len(rising) else np.inf))
    return starts


def predict(network: Network, values: Float, starts: NDArray[np.bool_]) -> Float:
    """Outputs (n, outputs) for inputs (n, inputs); NaN where a required input is missing.

    A window does not cross the first or the last row of its motion, which ``starts`` (n,) delimit: it repeats these
    rows.
    """
    optional = np.array([wanted.optional for wanted in network.metadata.inputs])
    cast, window = network.cast(values), network.metadata.window
    first = np.flatnonzero(starts)
    last = np.append(first[1:], len(values)) - 1
    motion = np.cumsum(starts) - 1
    out = np.full((len(values), len(network.metadata.outputs)), np.nan)
    for begin in range(0, len(values), AT_ONCE):
        rows = np.arange(begin, min(begin + AT_ONCE, len(values)))
        given = cast[rows]
        if window > 1:
            seen, own = rows[:, None] + np.arange(1 - window, 1) + network.metadata.delay, motion[rows, None]
            given = cast[np.clip(seen, first[own], last[own])]
        usable = whole(given, optional).reshape(len(rows), -1).all(axis=1)
        if usable.any():
            out[rows[usable]] = network.run(given[usable])
    return out


def _since(starts: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Rows since the start of the motion, (n,)."""
    rows = np.arange(len(starts))
    return rows - np.maximum.accumulate(np.where(starts, rows, 0))


def _check_rate(rate: float, table: Table, starts: NDArray[np.bool_], model: Path) -> None:
    if table.clock is None:
        return
    steps = np.diff(table.time)[~starts[1:]]
    if len(steps) and abs(rate * np.median(steps) - 1) > SAME_RATE:
        raise refused(
            model, f"it was trained on rows at {rate:g} Hz, those of {table.path} come at {1 / np.median(steps):g} Hz"
        )


def _outside(metadata: Metadata, values: Float) -> dict[str, int]:
    limits = Limits.of(np.array(metadata.training.range), [wanted.unit for wanted in metadata.inputs], OUTSIDE)
    counts = limits.left_by(values).sum(axis=0).tolist()
    return {wanted.channel: count for wanted, count in zip(metadata.inputs, counts, strict=True) if count}


def _numbered(column: Float) -> NDArray[Any]:
    """Whole numbers (N,) as integers, other columns unchanged."""
    with np.errstate(invalid="ignore"):
        whole = column.astype(np.int64)
    return whole if np.array_equal(whole, column) else column
