"""Sparkplug B payloads: the fields that an edge node needs, with the numbers of the specification 3.0. Pure.

Fields that are not in the table are passed over.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from cellwatt.errors import ProtocolError
from cellwatt.protobuf_classes import Messages, Table

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
    """Datatypes in use, with the numbers of the specification."""

    INT64 = 4
    UINT64 = 8
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12
    DATE_TIME = 13


_FIELD: Final = {
    DataType.INT64: "long_value",
    DataType.UINT64: "long_value",
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
    DataType.STRING: "string_value",
    DataType.DATE_TIME: "long_value",
}

Value = float | int | bool | str


@dataclass(frozen=True, slots=True)
class Metric:
    """A value with its time, UTC ms; ``value`` is ``None`` where there is none.

    ``datatype`` says how the value travels; ``declared`` puts it, and ``unit``, into the message. At least one of
    ``name`` and ``alias`` is there.
    """

    datatype: DataType
    value: Value | None
    timestamp: int
    name: str | None = None
    alias: int | None = None
    declared: bool = False
    unit: str | None = None
    historical: bool = False


def encode(metrics: Iterable[Metric], timestamp: int, seq: int | None) -> bytes:
    """A payload sent at ``timestamp`` UTC ms; the death certificate has no ``seq``."""
    payload = _MESSAGES.classes["Payload"](timestamp=timestamp)
    if seq is not None:
        payload.seq = seq
    for metric in metrics:
        _fill(payload.metrics.add(), metric)
    found: bytes = payload.SerializeToString()
    return found


def _fill(into: Any, metric: Metric) -> None:
    into.timestamp = metric.timestamp
    if metric.name is not None:
        into.name = metric.name
    if metric.alias is not None:
        into.alias = metric.alias
    if metric.declared:
        into.datatype = metric.datatype
        if metric.unit is not None:
            into.properties.keys.append("engUnit")
            into.properties.values.add(type=DataType.STRING, string_value=metric.unit)
    if metric.historical:
        into.is_historical = True
    if metric.value is None:
        into.is_null = True
    elif metric.datatype is DataType.INT64:
        into.long_value = int(metric.value) & (1 << 64) - 1
    else:
        setattr(into, _FIELD[metric.datatype], metric.value)


def decode(data: bytes) -> list[tuple[str | None, int | None, Value | None]]:
    """Name, alias and value of each metric of a command. Raises ``ProtocolError``."""
    return [_told(metric) for metric in _MESSAGES.parse("Payload", data, "a Sparkplug payload").metrics]


def _told(metric: Any) -> tuple[str | None, int | None, Value | None]:
    name = metric.name if metric.HasField("name") else None
    alias = metric.alias if metric.HasField("alias") else None
    field = metric.WhichOneof("value")
    value = None if field is None or metric.is_null else getattr(metric, field)
    if isinstance(name, bytes) or isinstance(value, bytes):  # so the library gives texts that are not UTF-8
        raise ProtocolError("a Sparkplug payload with a text that is not UTF-8")
    return name, alias, value
