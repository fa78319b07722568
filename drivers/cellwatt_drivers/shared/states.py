"""States of a robot, reported on change."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt.channel import Stream
from cellwatt.driver import Inlet


@dataclass(frozen=True, slots=True)
class State:
    """A channel whose values have ``names``; a change is an event of this ``kind``, its text begins with ``title``.

    ``digits`` writes a value without a name.
    """

    kind: str
    title: str
    names: Mapping[int, str]
    unknown: str = "nan"
    digits: Callable[[float], str] = "{:g}".format

    def name(self, value: float) -> str:
        """Return the name of a value, or its digits; ``unknown`` for NaN."""
        return self.unknown if np.isnan(value) else self.names.get(value) or self.digits(value)  # type: ignore[call-overload]


class StateWatch:
    """Reports each change of the stream's ``states`` (by channel)."""

    def __init__(self, inlet: Inlet, stream: Stream, states: Mapping[str, State]) -> None:
        self._inlet = inlet
        self._states = [states[name] for name in stream.names if name in states]
        self._columns = np.array([i for i, name in enumerate(stream.names) if name in states], dtype=np.intp)
        self._before: Float | None = None

    def see(self, values: Float) -> None:
        """Compare the next samples (n, channels) of the stream, each with its predecessor."""
        if not len(self._columns):
            return
        found = values.take(self._columns, axis=1)
        before = found[0] if self._before is None else self._before
        self._before = found[-1]
        if found.tobytes() == before.tobytes() * len(found):
            return
        rows = np.vstack((before, found))
        changed = (rows[1:] != rows[:-1]) & ~(np.isnan(rows[1:]) & np.isnan(rows[:-1]))
        for row, column in np.argwhere(changed):
            state = self._states[column]
            old, new = (state.name(value) for value in rows[row : row + 2, column])
            self._inlet.event(state.kind, f"{state.title}: {old} → {new}", before=old, after=new)
