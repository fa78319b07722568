"""Values of the last minute, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

SPAN: Final = 60.0
"""s that are kept."""
_MOST: Final = 2_000_000
"""Values that are kept at most, so that a thousand channels at 1 kHz do not fill the memory."""
_FIRST: Final = 256


class LastMinute:
    """The last ``SPAN`` s of columns that share their times; fewer where that would be more than two million values."""

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.units: tuple[str, ...] = ()
        self._begin((), ())

    def _begin(self, names: tuple[str, ...], units: tuple[str, ...]) -> None:
        self.names, self.units = names, units
        self._column = {name: i for i, name in enumerate(names)}
        self._time = np.empty(_FIRST, np.int64)
        self._values = np.empty((len(names), _FIRST))
        self._count = 0

    def add(
        self, time: NDArray[np.int64], names: Sequence[str], units: Sequence[str], values: NDArray[np.float64]
    ) -> None:
        """Append ``values`` (n, names) at ``time`` (n,) ns; other names, or times that went back, begin anew."""
        if tuple(names) != self.names:
            self._begin(tuple(names), tuple(units))
        if not len(time):
            return
        self._count = int(np.searchsorted(self.time, time[0]))
        self._make_room(len(time))
        end = self._count + len(time)
        self._time[self._count : end] = time
        self._values[:, self._count : end] = values.T
        self._count = end

    @property
    def time(self) -> NDArray[np.int64]:
        """Times (n,), ns, rising."""
        return self._time[: self._count]

    def within(self, seconds: float) -> slice:
        """Rows of the last ``seconds``."""
        time = self.time
        return slice(int(np.searchsorted(time, time[-1] - round(seconds * 1e9))) if len(time) else 0, self._count)

    def of(self, name: str) -> NDArray[np.float64]:
        """Values (n,) of a column, NaN where missing."""
        return self._values[self._column[name], : self._count]

    def _make_room(self, more: int) -> None:
        """Room for ``more`` rows: forget what is too old; grow while at least half would be full, up to the limit."""
        if self._count + more <= len(self._time):
            return
        young = self._count - self.within(SPAN).start
        room = len(self._time)
        if 2 * (young + more) > room:
            room = min(2 * room, max(_FIRST, _MOST // max(1, len(self.names))))
        kept = min(young, room // 2)
        time, values = np.empty(max(room, kept + more), np.int64), np.empty((len(self.names), max(room, kept + more)))
        time[:kept] = self._time[self._count - kept : self._count]
        values[:, :kept] = self._values[:, self._count - kept : self._count]
        self._time, self._values, self._count = time, values, kept
