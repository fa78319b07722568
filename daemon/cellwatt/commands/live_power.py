"""Predicted beside measured power of the last seconds, for the live view."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from statistics import fmean
from typing import Any

from rich.text import Text

from cellwatt.frames import Frames

SPAN = 8.0
"""s that are shown."""
POINTS = 32
"""Bars of a course."""
BARS = "▁▂▃▄▅▆▇█"
MEASURED = ("supply.power", "bus.power")
"""Channels, without their source, that measure what an arm draws."""

Course = deque[tuple[int, float]]
"""Time, ns, and W."""


@dataclass
class LivePower:
    """Collects frames and predictions, in any order, and matches them by time.

    ``channel`` is the measured one; by default each ``supply.power`` or ``bus.power`` of the cell is shown.
    """

    channel: str | None = None
    measured: dict[str, Course] = field(default_factory=dict)
    predicted: dict[tuple[str, str], Course] = field(default_factory=dict)
    """By model and output."""

    def add_frames(self, content: Mapping[str, Any]) -> None:
        """Take frames in the form of ``power_of_frames``."""
        for name, values in content.get("power", {}).items():
            if name == self.channel or (self.channel is None and name.partition(".")[2] in MEASURED):
                _append(self.measured.setdefault(name, deque()), content["time"], values)

    def add_prediction(self, content: Mapping[str, Any]) -> None:
        """Take a prediction; outputs other than power are ignored."""
        for output, unit in content["units"].items():
            if unit == "W":
                course = self.predicted.setdefault((content["model"], output), deque())
                _append(course, content["time"], content["outputs"][output])

    def lines(self) -> Iterator[Text]:
        """Lines to show: the course of each predicted power, then each measured one and their difference."""
        measured = {name: dict(course) for name, course in self.measured.items() if course}
        for (model, output), course in self.predicted.items():
            if not course:
                continue
            said = dict(course)
            scale = _Scale.of([said, *measured.values()])
            yield _line(f"predicted ({model})" if output == "power" else f"{output} ({model})", said, scale)
            for channel, values in measured.items():
                both = [(values[time], value) for time, value in said.items() if time in values]
                apart = f"  off {fmean((a - b) ** 2 for a, b in both) ** 0.5:.1f} W rms" if both else ""
                yield _line(channel, values, scale).append(apart, style="bold")


@dataclass(frozen=True)
class _Scale:
    """Scale shared by all courses, so that bars can be compared."""

    low: float
    high: float
    first: int
    last: int

    @classmethod
    def of(cls, courses: Sequence[Mapping[int, float]]) -> _Scale:
        times = [time for course in courses for time in course]
        values = [value for course in courses for value in course.values()]
        return cls(min(values), max(values), min(times), max(times))


def power_of_frames(frames: Frames) -> dict[str, Any]:
    """Power in frames: ``time`` ns and ``power`` W by channel, ``None`` where missing; empty without power channels."""
    power = {
        channel.name: [value if isfinite(value) else None for value in values.tolist()]
        for channel, values in zip(frames.layout.channels, frames.values.T, strict=True)
        if channel.unit == "W"
    }
    return {"time": frames.time.tolist(), "power": power} if power else {}


def bars(values: Sequence[float], low: float, high: float) -> str:
    """One bar a value between two limits."""
    return "".join(BARS[round((value - low) / ((high - low) or 1.0) * (len(BARS) - 1))] for value in values)


def _append(course: Course, time: Sequence[int], values: Sequence[float | None]) -> None:
    """Append the values that are known, and keep only the last ``SPAN``."""
    known = ((at, value) for at, value in zip(time, values, strict=True) if value is not None and isfinite(value))
    course.extend(known)
    while course and course[0][0] < course[-1][0] - SPAN * 1e9:
        course.popleft()


def _line(name: str, values: Mapping[int, float], scale: _Scale) -> Text:
    parts: list[list[float]] = [[] for _ in range(POINTS)]
    for time, value in values.items():
        parts[(time - scale.first) * POINTS // (scale.last - scale.first + 1)].append(value)
    text = Text(f"{name:<20} ", style="bold")
    course = "".join(bars([fmean(part)], scale.low, scale.high) if part else " " for part in parts)
    return text.append(course, style="cyan").append(f" {values[max(values)]:6.1f} W", style="not bold")
