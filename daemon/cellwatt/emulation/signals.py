"""Signals of an emulated device: a recording, or any object that returns channels as a function of time."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from cellwatt.arrays import Float
from cellwatt.tables import read_table
from cellwatt.tables.names import understood

log = logging.getLogger(__name__)


class Signals(Protocol):
    """Channels as a function of time since the emulation's epoch."""

    def at(self, t: Float) -> Mapping[str, Float]:
        """Channel name → values (n,) in SI units at times t (n,) s."""
        ...

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """Change the emulated world (e.g. ``{"spring": 3, …}``); raises ``ValueError`` for an unknown change."""
        ...


def table_of(values: Mapping[str, Float], names: Sequence[str], n: int) -> Float:
    """The channels ``names`` as columns (n, names); absent ones are 0."""
    zero = np.zeros(n)
    return np.stack([values.get(name, zero) for name in names], axis=1)


@dataclass(frozen=True)
class RecordedSignals:
    """A recording as signals: ``time`` (n,) s, rising; ``columns`` name → (n,).

    Emulators that can do so send the recorded rows themselves at their own times; ``at`` interpolates linearly, and
    with ``loop`` starts again at the end.
    """

    time: Float
    columns: Mapping[str, Float]
    loop: bool = False

    @property
    def length(self) -> float:
        """Duration from first to last row, s."""
        return float(self.time[-1] - self.time[0])

    def at(self, t: Float) -> Mapping[str, Float]:
        """See ``Signals.at``; the first row holds before the start, the last row after the end.

        Non-finite cells are interpolated; a column with no finite cell is omitted.
        """
        inside = np.mod(t, self.length) if self.loop and self.length > 0 else t
        when = self.time[0] + inside
        return {name: np.interp(when, time, values) for name, (time, values) in self._known.items()}

    @cached_property
    def _known(self) -> Mapping[str, tuple[Float, Float]]:
        finite = {name: np.isfinite(values) for name, values in self.columns.items()}
        return {name: (self.time[rows], self.columns[name][rows]) for name, rows in finite.items() if rows.any()}

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """A recording cannot be changed."""
        raise ValueError(f"a recording cannot be disturbed ({', '.join(change)})")


def load_signals(path: Path, *, loop: bool = False) -> RecordedSignals:
    """Read a table or a recording as signals, named as its columns, in SI units if the file names units.

    A channel of a cell is also named without its source: ``joint_1.position`` for ``arm.joint_1.position``, unless
    several sources have it, which is logged. Raises ``RecordingError`` if the file cannot be read, or has no rising
    time.
    """
    table = read_table(path)
    time = table.rising_time()
    columns = {name: table.plain(name) for name in table.columns if name != table.clock}
    ends = [(name[dot.end() :], name) for name in columns for dot in re.finditer(r"\.", name)]
    count = Counter(end for end, _ in ends)
    if several := [end for end in count if count[end] > 1 and "." in end and understood(end) is not None]:
        log.warning("%s: several sources have %s: only a name with its source is served", path, ", ".join(several))
    return RecordedSignals(time, {end: columns[name] for end, name in ends if count[end] == 1} | columns, loop)
