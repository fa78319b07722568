"""Metrics of a Sparkplug edge node and of its devices: names, aliases and current values. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count

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


def values_of(item: Result | Event) -> tuple[int, Values]:
    """Time, UTC ms, and values of a result by the names of their metrics; none of what Sparkplug has no place for."""
    match item:
        case Task():
            return item.end // MS, _below(f"{item.source}/task", dict(_task(item)))
        case Energy():
            return item.end // MS, _below(f"{item.source}/energy", dict(_energy(item)))
        case Interval() if item.closed:
            return item.end // MS, _below(f"{item.source}/interval", dict(_interval(item)))
        case Alarm():
            return item.time // MS, _below("alarms/last", dict(_alarm(item)))
        case _:
            return 0, {}


def _task(task: Task) -> Iterator[tuple[str, tuple[DataType, Value | None, str | None]]]:
    yield "name", (DataType.STRING, task.name, None)
    yield "variant", (DataType.STRING, task.variant, None)
    yield "repetition", (DataType.INT64, task.repetition, None)
    yield "speed", (DataType.DOUBLE, finite(task.speed), None)
    yield "start", (DataType.DATE_TIME, task.start // MS, None)
    yield "end", (DataType.DATE_TIME, task.end // MS, None)


def _energy(energy: Energy) -> Iterator[tuple[str, tuple[DataType, Value | None, str | None]]]:
    yield "task", (DataType.STRING, energy.task, None)
    yield "variant", (DataType.STRING, energy.variant, None)
    yield "repetition", (DataType.INT64, energy.repetition, None)
    yield "total", (DataType.DOUBLE, finite(energy.total), "J")
    yield "uncertainty", (DataType.DOUBLE, finite(energy.uncertainty), "J")
    yield "per_part", (DataType.DOUBLE, finite(energy.total_per_part), "J")
    for name, value in energy.groups.items():
        yield f"groups/{name}", (DataType.DOUBLE, finite(value), "J")


def _interval(interval: Interval) -> Iterator[tuple[str, tuple[DataType, Value | None, str | None]]]:
    yield "number", (DataType.UINT64, interval.number, None)
    yield "moving", (DataType.STRING, " ".join(map(str, interval.moving)), None)
    yield "start", (DataType.DATE_TIME, interval.start // MS, None)
    yield "end", (DataType.DATE_TIME, interval.end // MS, None)
    yield "complete", (DataType.BOOLEAN, interval.complete, None)


def _alarm(alarm: Alarm) -> Iterator[tuple[str, tuple[DataType, Value | None, str | None]]]:
    yield "id", (DataType.STRING, alarm.id, None)
    yield "kind", (DataType.STRING, alarm.kind, None)
    yield "severity", (DataType.STRING, alarm.severity, None)
    yield "active", (DataType.BOOLEAN, alarm.active, None)
    yield "since", (DataType.DATE_TIME, alarm.since // MS, None)
    yield "statement", (DataType.STRING, alarm.statement, None)
    yield "source", (DataType.STRING, alarm.source or "", None)


def _below(folder: str, values: Values) -> Values:
    return {f"{folder}/{name}": value for name, value in values.items()}


def finite(value: float | None) -> float | None:
    """A number, or ``None`` where it is none."""
    return None if value is None or not math.isfinite(value) else value
