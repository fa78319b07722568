"""Metrics of a Sparkplug edge node and of its devices: names, aliases and current values. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Any, Final, cast

from cellwatt.outlets.mqtt.payload import DataType, Metric, Value
from cellwatt.results import Alarm, Energy, Event, Interval, Result, Task

MS = 1_000_000
"""ns."""


@dataclass(slots=True)
class Tag:
    """A metric with its current value and the time of that, UTC ms; without ``alias`` it is always named."""

    name: str
    datatype: DataType
    alias: int | None
    unit: str | None = None
    value: Value | None = None
    time: int = 0

    def born(self, now: int) -> Metric:
        """The metric as a birth declares it at ``now`` ms."""
        at = self.time or now
        return Metric(self.datatype, self.value, at, self.name, self.alias, declared=True, unit=self.unit)

    def data(self, value: Value | None, time: int, historical: bool) -> Metric:
        """A value of the metric as data."""
        return Metric(self.datatype, value, time, alias=self.alias, historical=historical)


@dataclass(slots=True)
class Device:
    """A device, or the edge node itself: its metrics by name. ``grown``: some were added since its birth."""

    tags: dict[str, Tag] = field(default_factory=dict)
    born: bool = False
    grown: bool = False

    @property
    def present(self) -> bool:
        """True if any of its metrics has a value."""
        return any(tag.value is not None for tag in self.tags.values())


class Tags:
    """All metrics of an edge node; an alias is given once, and to one metric."""

    def __init__(self) -> None:
        self.node = Device()
        self.devices: dict[str, Device] = {}
        self._aliases = count(1)

    def declare(self, device: Device, name: str, datatype: DataType, unit: str | None = None) -> Tag:
        """The metric of that name, added if it is new; one whose unit becomes known keeps its value."""
        before = device.tags.get(name)
        if before is not None and (before.datatype, before.unit) == (datatype, unit):
            return before
        tag = device.tags[name] = Tag(name, datatype, next(self._aliases), unit)
        if before is not None and before.datatype is datatype and before.unit is None:
            tag.value, tag.time = before.value, before.time
        device.grown = True
        return tag

    def channel(self, name: str, unit: str | None) -> tuple[str, Tag]:
        """Device and metric of a channel of the frames; ``unit`` is ``None`` where it is not known (any more)."""
        source, _, short = name.partition(".")
        device, short = self.devices.setdefault(source, Device()), short.replace(".", "/")
        if unit is None and short in device.tags:
            return source, device.tags[short]
        return source, self.declare(device, short, DataType.DOUBLE, None if unit == "1" else unit)


Values = Mapping[str, tuple[DataType, Value | None, str | None]]
"""Datatype, value and unit by name."""


_TEXT, _WHOLE, _NUMBER, _AT = DataType.STRING, DataType.INT64, DataType.DOUBLE, DataType.DATE_TIME
_METRICS: Final[Mapping[type, tuple[tuple[str, DataType, str | None], ...]]] = {
    Task: (
        ("name", _TEXT, None), ("variant", _TEXT, None), ("repetition", _WHOLE, None), ("speed", _NUMBER, None),
        ("start", _AT, None), ("end", _AT, None),
    ),
    Energy: (
        ("task", _TEXT, None), ("variant", _TEXT, None), ("repetition", _WHOLE, None), ("total", _NUMBER, "J"),
        ("uncertainty", _NUMBER, "J"), ("total_per_part", _NUMBER, "J"),
    ),
    Interval: (
        ("number", DataType.UINT64, None), ("moving", _TEXT, None), ("start", _AT, None), ("end", _AT, None),
        ("complete", DataType.BOOLEAN, None),
    ),
    Alarm: (
        ("id", _TEXT, None), ("kind", _TEXT, None), ("severity", _TEXT, None), ("active", DataType.BOOLEAN, None),
        ("since", _AT, None), ("statement", _TEXT, None), ("source", _TEXT, None),
    ),
}  # fmt: skip
"""Fields of results that become metrics, with their units."""
_NAMES: Final = {"total_per_part": "per_part"}


def values_of(item: Result | Event) -> tuple[int, Values]:
    """Time, UTC ms, and values of a result by the names of their metrics; none of what Sparkplug has no place for."""
    fields, told = _METRICS.get(type(item)), cast(Any, item)
    if fields is None or (isinstance(item, Interval) and not item.closed):
        return 0, {}
    values = {_NAMES.get(name, name): (kind, _value(getattr(told, name), kind), unit) for name, kind, unit in fields}
    if isinstance(item, Energy):
        values |= {f"groups/{name}": (_NUMBER, finite(value), "J") for name, value in item.groups.items()}
    folder = "alarms/last" if isinstance(item, Alarm) else f"{told.source}/{type(item).__name__.lower()}"
    time = told.time if isinstance(item, Alarm) else told.end
    return time // MS, {f"{folder}/{name}": value for name, value in values.items()}


def _value(value: Any, kind: DataType) -> Value | None:
    """A field as a metric has it."""
    match kind:
        case DataType.DATE_TIME:
            return int(value) // MS
        case DataType.DOUBLE:
            return finite(value)
        case DataType.STRING:
            return " ".join(map(str, value)) if isinstance(value, tuple) else value or ""
    found: Value = value
    return found


def finite(value: float | None) -> float | None:
    """A number, or ``None`` where it is none."""
    return None if value is None or not math.isfinite(value) else value
