"""Sparkplug B payloads, with the field numbers of specification 3.0, and the metrics of an edge node. Pure.

Fields that are not in the table are ignored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from itertools import count
from typing import Any, Final, cast

from cellwatt.errors import ProtocolError
from cellwatt.protobuf import Messages, Table
from cellwatt.results import Alarm, Energy, Event, Interval, Result, Task

_VALUES: Final = {
    "int_value": "uint32",
    "long_value": "uint64",
    "float_value": "float",
    "double_value": "double",
    "boolean_value": "bool",
    "string_value": "string",
}
_TABLE: Final[Table] = {
    "PropertyValue": {
        "type": (1, "uint32"),
        "is_null": (2, "bool"),
        **{name: (3 + i, f"{kind}.") for i, (name, kind) in enumerate(_VALUES.items())},
    },
    "PropertySet": {"keys": (1, "string*"), "values": (2, "PropertyValue*")},
    "Metric": {
        "name": (1, "string"),
        "alias": (2, "uint64"),
        "timestamp": (3, "uint64"),
        "datatype": (4, "uint32"),
        "is_historical": (5, "bool"),
        "is_null": (7, "bool"),
        "properties": (9, "PropertySet"),
        **{name: (10 + i, f"{kind}.") for i, (name, kind) in enumerate(_VALUES.items())},
    },
    "Payload": {"timestamp": (1, "uint64"), "metrics": (2, "Metric*"), "seq": (3, "uint64")},
}
_MESSAGES: Final = Messages("cellwatt.sparkplug", _TABLE)


class DataType(IntEnum):
    """Datatypes used here, with the numbers of the specification."""

    INT64 = 4
    UINT64 = 8
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12
    DATE_TIME = 13


_FIELD: Final = {
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
    DataType.STRING: "string_value",
}
"""Field of each datatype's value; integers and times use ``long_value``, 64 bits."""

Value = float | int | bool | str


Metric = Any
"""A metric of a payload."""


def metric(
    datatype: DataType,
    value: Value | None,
    timestamp: int,
    name: str | None = None,
    alias: int | None = None,
    *,
    declared: bool = False,
    unit: str | None = None,
    historical: bool = False,
) -> Metric:
    """A metric with its time, UTC ms; ``value`` is ``None`` for a null metric.

    ``datatype`` selects the encoding; ``declared`` adds it, and ``unit``, to the message. Give ``name``, ``alias`` or
    both.
    """
    made = _MESSAGES.classes["Metric"](timestamp=timestamp, name=name, alias=alias)
    if declared:
        made.datatype = datatype
        if unit is not None:
            made.properties.keys.append("engUnit")
            made.properties.values.add(type=DataType.STRING, string_value=unit)
    if historical:
        made.is_historical = True
    if value is None:
        made.is_null = True
    elif (field := _FIELD.get(datatype)) is not None:
        setattr(made, field, value)
    else:
        made.long_value = int(value) & (1 << 64) - 1
    return made


def encode(metrics: Sequence[Metric], timestamp: int, seq: int | None) -> bytes:
    """A payload sent at ``timestamp``, UTC ms; the death certificate has no ``seq``."""
    found: bytes = _MESSAGES.classes["Payload"](timestamp=timestamp, seq=seq, metrics=metrics).SerializeToString()
    return found


def decode(data: bytes) -> list[tuple[str | None, Value | None]]:
    """Name and value of each metric of a command. Raises ``ProtocolError``."""
    return [_told(told) for told in _MESSAGES.parse("Payload", data, "a Sparkplug payload").metrics]


def _told(told: Metric) -> tuple[str | None, Value | None]:
    field = told.WhichOneof("value")
    name = told.name if told.HasField("name") else None
    value = None if field is None or told.is_null else getattr(told, field)
    if isinstance(name, bytes) or isinstance(value, bytes):  # the library returns invalid UTF-8 as bytes
        raise ProtocolError("a Sparkplug payload with a text that is not UTF-8")
    return name, value


MS = 1_000_000
"""One millisecond, ns."""


@dataclass(slots=True)
class Tag:
    """A metric with its current value and the value's time, UTC ms; without ``alias`` it is always sent by name."""

    name: str
    datatype: DataType
    alias: int | None
    unit: str | None = None
    value: Value | None = None
    time: int = 0

    def born(self, now: int) -> Metric:
        """The metric as declared in a birth at ``now``, UTC ms."""
        at = self.time or now
        return metric(self.datatype, self.value, at, self.name, self.alias, declared=True, unit=self.unit)

    def data(self, value: Value | None, time: int, historical: bool) -> Metric:
        """A value of the metric in a data message."""
        return metric(self.datatype, value, time, alias=self.alias, historical=historical)


@dataclass(slots=True)
class Device:
    """A device, or the edge node itself: its metrics by name. ``grown``: metrics were added since its birth."""

    tags: dict[str, Tag] = field(default_factory=dict)
    born: bool = False
    grown: bool = False

    @property
    def present(self) -> bool:
        """True if any of its metrics has a value."""
        return any(tag.value is not None for tag in self.tags.values())


class Tags:
    """All metrics of an edge node; each alias belongs to one metric and is never reused."""

    def __init__(self) -> None:
        self.node = Device()
        self.devices: dict[str, Device] = {}
        self._aliases = count(1)

    def declare(self, device: Device, name: str, datatype: DataType, unit: str | None = None) -> Tag:
        """The metric of that name, added if new; a metric whose unit becomes known retains its value."""
        before = device.tags.get(name)
        if before is not None and (before.datatype, before.unit) == (datatype, unit):
            return before
        tag = device.tags[name] = Tag(name, datatype, next(self._aliases), unit)
        if before is not None and before.datatype is datatype and before.unit is None:
            tag.value, tag.time = before.value, before.time
        device.grown = True
        return tag

    def channel(self, name: str, unit: str | None) -> tuple[str, Tag]:
        """Device and metric of a channel of the frames; ``unit`` is ``None`` if it is unknown, or no longer known."""
        source, _, short = name.partition(".")
        device, short = self.devices.setdefault(source, Device()), short.replace(".", "/")
        if unit is None and short in device.tags:
            return source, device.tags[short]
        return source, self.declare(device, short, DataType.DOUBLE, None if unit == "1" else unit)


Values = Mapping[str, tuple[DataType, Value | None, str | None]]
"""(datatype, value, unit) by name."""


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
"""Fields of results that are sent as metrics: (name, datatype, unit)."""
_NAMES: Final = {"total_per_part": "per_part"}


def values_of(item: Result | Event) -> tuple[int, Values]:
    """Time, UTC ms, and values of a result by metric name; no values for events and running intervals."""
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
    """A field's value as a metric value."""
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
    """A number, or ``None`` if it is not finite."""
    return None if value is None or not math.isfinite(value) else value
