"""Sparkplug B payloads: the fields that an edge node needs, with the numbers of the specification 3.0. Pure.

The message classes are made from a table and live in a pool of their own, so that another library's Sparkplug in the
same process does not clash with them. Fields that are not in the table are passed over.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any, Final

from cellwatt.errors import ProtocolError

_PACKAGE: Final = "cellwatt.sparkplug"
_SCALARS: Final = {"double": 1, "float": 2, "uint64": 4, "bool": 8, "string": 9, "uint32": 13}
_MESSAGE: Final = 11

# field: (number, type); a type with a star repeats, one with a dot is a value: at most one of them is there.
_VALUES: Final = {
    "int_value": "uint32",
    "long_value": "uint64",
    "float_value": "float",
    "double_value": "double",
    "boolean_value": "bool",
    "string_value": "string",
}
_TABLE: Final[Mapping[str, Mapping[str, tuple[int, str]]]] = {
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


@cache
def _classes() -> Mapping[str, Any]:
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    file = descriptor_pb2.FileDescriptorProto(name="cellwatt/sparkplug.proto", package=_PACKAGE, syntax="proto2")
    for name, fields in _TABLE.items():
        message = file.message_type.add(name=name)
        for field, (number, kind) in fields.items():
            plain = kind.rstrip("*.")
            added = message.field.add(name=field, number=number, label=3 if kind.endswith("*") else 1)
            added.type = _SCALARS.get(plain, _MESSAGE)
            if plain not in _SCALARS:
                added.type_name = f".{_PACKAGE}.{plain}"
            if kind.endswith("."):
                if not message.oneof_decl:
                    message.oneof_decl.add(name="value")
                added.oneof_index = 0
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{_PACKAGE}.{name}")) for name in _TABLE}


def encode(metrics: Iterable[Metric], timestamp: int, seq: int | None) -> bytes:
    """A payload sent at ``timestamp`` UTC ms; the death certificate has no ``seq``."""
    payload = _classes()["Payload"](timestamp=timestamp)
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
    from google.protobuf.message import DecodeError

    payload = _classes()["Payload"]()
    try:
        payload.ParseFromString(data)
    except DecodeError as error:
        raise ProtocolError(f"{len(data)} bytes that are not a Sparkplug payload") from error
    return [_told(metric) for metric in payload.metrics]


def _told(metric: Any) -> tuple[str | None, int | None, Value | None]:
    name = metric.name if metric.HasField("name") else None
    alias = metric.alias if metric.HasField("alias") else None
    field = metric.WhichOneof("value")
    value = None if field is None or metric.is_null else getattr(metric, field)
    if isinstance(name, bytes) or isinstance(value, bytes):  # so the library gives texts that are not UTF-8
        raise ProtocolError("a Sparkplug payload with a text that is not UTF-8")
    return name, alias, value
