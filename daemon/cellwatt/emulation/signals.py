"""What an emulated device measures: a recording, or anything that gives channels as a function of time."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt.files import check_file
from cellwatt.parquet import read_parquet

Float = NDArray[np.float64]


class Signals(Protocol):
    """Channels as a function of time since the emulation's epoch."""

    def at(self, t: Float) -> Mapping[str, Float]:
        """Channel name → values (n,) in SI units at times t (n,) s."""
        ...

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Change the emulated world (e.g. ``{"spring": 3, …}``); raises ``ValueError`` on what it does not know."""
        ...


@dataclass(frozen=True)
class RecordedSignals:
    """A recording as signals: ``time`` (n,) s, rising; ``columns`` name → (n,).

    Emulators that can, send the rows themselves at their own times (``rows``); ``at`` interpolates linearly,
    and starts again at the end when ``loop``.
    """

    time: Float
    columns: Mapping[str, Float]
    loop: bool = False

    @property
    def length(self) -> float:
        """Duration from first to last row, s."""
        return float(self.time[-1] - self.time[0])

    def at(self, t: Float) -> Mapping[str, Float]:
        """See ``Signals.at``; before the start and after the end the first and last row hold."""
        inside = np.mod(t, self.length) if self.loop and self.length > 0 else t
        when = self.time[0] + inside
        return {name: np.interp(when, self.time, values) for name, values in self.columns.items()}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """A recording cannot be changed."""
        raise ValueError(f"a recording cannot be disturbed ({', '.join(change)})")


def load_signals(path: Path, *, loop: bool = False) -> RecordedSignals:
    """A CSV (comma, semicolon or blank separated, header row) or Parquet file as signals.

    The first of the columns ``timestamp``, ``t``, ``time`` is the time in s. Raises ``RecordingError``
    where there is none, it does not rise, or the file cannot be read.
    """
    try:
        names, table = _parquet(path) if path.suffix == ".parquet" else _csv(path)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: cannot be read as a table: {error}") from error
    clock = next((n for n in ("timestamp", "t", "time") if n in names), None)
    if clock is None:
        raise RecordingError(f"{path}: no column named timestamp, t or time; there are: {', '.join(names[:8])} …")
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: two columns are called {twice!r}")
    columns = dict(zip(names, table.T, strict=True))
    time = columns.pop(clock)
    if len(time) < 2 or np.any(np.diff(time) <= 0):
        raise RecordingError(f"{path}: column {clock} does not rise from row to row")
    return RecordedSignals(time, columns, loop)


def _csv(path: Path) -> tuple[list[str], Float]:
    check_file(path)
    with path.open(newline=None) as file:
        header = file.readline()
        separator = next((s for s in (",", ";", "\t") if s in header), None)
        names = [n.strip() for n in header.strip().split(separator)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a table without rows, which is refused below
            table = np.genfromtxt(file, delimiter=separator, dtype=np.float64, ndmin=2)
    if table.shape[1] != len(names):
        raise ValueError(f"{len(names)} names in the header but {table.shape[1]} columns")
    return names, table


def _parquet(path: Path) -> tuple[list[str], Float]:
    table = read_parquet(path)
    return table.column_names, np.column_stack([np.asarray(c, dtype=np.float64) for c in table.columns])
