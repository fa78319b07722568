"""Predicted beside measured power, on one scale."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from cellwatt.live.history import History
from cellwatt.live.lines import fit
from cellwatt.live.sparkline import bars, parts
from cellwatt.live.state import LiveCell

MEASURED: Final = ("supply.power", "bus.power")
"""Channels, without their source, that measure what an arm draws."""
_NAME: Final = 20
_FIGURES: Final = 27
"""Cells of the name, and of the figures after a course."""


@dataclass(frozen=True, slots=True)
class _Course:
    """Values of a name that are known."""

    name: str
    time: NDArray[np.int64]
    values: NDArray[np.float64]

    @classmethod
    def of(cls, name: str, history: History, column: str, span: float) -> _Course:
        rows = history.within(span)
        values = history.of(column)[rows]
        known = np.isfinite(values)
        return cls(name, history.time[rows][known], values[known])

    def line(self, beside: Sequence[_Course], count: int) -> Text:
        """Name, ``count`` bars on the scale that ``beside`` shares, and the latest value."""
        low, high = min(c.values.min() for c in beside), max(c.values.max() for c in beside)
        start, end = min(int(c.time[0]) for c in beside), max(int(c.time[-1]) for c in beside)
        text = fit(Text(self.name, "bold"), _NAME)
        text.pad_right(_NAME + 1 - text.cell_len)
        text.append(bars(parts(self.time, self.values, start, end, count), low, high), "not bold cyan")
        return text.append(f" {self.values[-1]:6.1f} W", style="not bold")

    def apart(self, other: _Course) -> str:
        """Root mean square of the difference, of values of the same frame only."""
        _, a, b = np.intersect1d(self.time, other.time, assume_unique=True, return_indices=True)
        return f"  off {float(np.mean((self.values[a] - other.values[b]) ** 2)) ** 0.5:.1f} W rms" if len(a) else ""


def power(cell: LiveCell, span: float, width: int, channel: str | None = None) -> Iterator[Text]:
    """Lines of the course of each predicted power, then of each measured one and their difference.

    ``channel`` is the measured one; by default each ``supply.power`` and ``bus.power`` of the cell is.
    """
    count = max(10, min(120, width - _NAME - _FIGURES))
    every = (_Course.of(name, cell.frames, name, span) for name in _measured(cell.frames, channel))
    measured = [course for course in every if len(course.time)]
    for model, history in cell.predicted.items():
        for output in (o for o, unit in zip(history.names, history.units, strict=True) if unit == "W"):
            name = f"predicted ({model})" if output == "power" else f"{output} ({model})"
            said = _Course.of(name, history, output, span)
            if not len(said.time):
                continue
            yield said.line([said, *measured], count)
            for course in measured:
                yield course.line([said, *measured], count).append(said.apart(course))


def _measured(frames: History, channel: str | None) -> list[str]:
    pairs = zip(frames.names, frames.units, strict=True)
    if channel is not None:
        return [name for name, _ in pairs if name == channel]
    return [name for name, unit in pairs if unit == "W" and name.partition(".")[2] in MEASURED]
