"""Protocol Buffers: encoding by hand for recordings, and message classes built from a table.

A recorded channel's message type is known only at run time, so its FileDescriptorSet is written by hand: a few
bytes a field (google/protobuf/descriptor.proto), without the protobuf library. Message classes are registered in a
pool of their own, so that they do not clash with another library's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any, Final

from cellwatt.errors import ProtocolError

VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5
"""Wire types."""


class Kind(IntEnum):
    """FieldDescriptorProto.Type of the kinds in use."""

    DOUBLE = 1
    FIXED32 = 7
    BYTES = 12
    SFIXED64 = 16


@dataclass(frozen=True, slots=True)
class Field:
    """A field of a message; ``repeated`` fields are packed."""

    name: str
    number: int
    kind: Kind
    repeated: bool = False


def varint(value: int) -> bytes:
    """An unsigned integer in base 128, low group first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def tag(number: int, wire: int) -> bytes:
    """Tag in front of a field's value."""
    return varint(number << 3 | wire)


def _text(number: int, value: str | bytes) -> bytes:
    raw = value.encode() if isinstance(value, str) else value
    return tag(number, LENGTH) + varint(len(raw)) + raw


def _field(field: Field) -> bytes:
    parts = _text(1, field.name)
    parts += tag(3, VARINT) + varint(field.number)
    parts += tag(4, VARINT) + varint(3 if field.repeated else 1)
    parts += tag(5, VARINT) + varint(field.kind)
    if field.repeated:
        parts += _text(8, tag(2, VARINT) + varint(1))
    # The explicit JSON name keeps names that differ in underscores only from clashing in camel case.
    return parts + _text(10, field.name)


def file_descriptor_set(package: str, message: str, fields: Iterable[Field]) -> bytes:
    """A serialised FileDescriptorSet with one proto2 message in one file."""
    body = _text(1, message) + b"".join(_text(2, _field(f)) for f in fields)
    file = _text(1, f"{package}/{message}.proto") + _text(2, package) + _text(4, body)
    return _text(1, file)


def identifiers(names: Sequence[str], taken: Iterable[str] = ()) -> tuple[str, ...]:
    """Names as Protocol Buffers allow them: ``joint_1.position`` becomes ``joint_1_position``.

    They are made unique among themselves and ``taken`` by a number at the end.
    """
    used = set(taken)
    out: list[str] = []
    for name in names:
        plain, n = re.sub(r"[^A-Za-z0-9_]", "_", name), 1
        unique = plain = plain if plain[:1].isalpha() else f"_{plain}"
        while unique in used:
            n += 1
            unique = f"{plain}_{n}"
        used.add(unique)
        out.append(unique)
    return tuple(out)


Table = Mapping[str, Mapping[str, tuple[int, str]]]
"""Fields by message: number and type. ``*`` after a type: repeated; ``.``: member of a oneof."""
_SCALARS: Final = {"double": 1, "float": 2, "uint64": 4, "enum": 5, "bool": 8, "string": 9, "uint32": 13}
"""Types by name; an enum is encoded as an int32."""
_MESSAGE: Final = 11


class Messages:
    """Messages of ``package`` (proto2) with optional fields only; the first use imports the protobuf library."""

    def __init__(self, package: str, table: Table) -> None:
        self._package, self._table = package, table

    def parse(self, name: str, data: bytes, what: str) -> Any:
        """Decode a message. Raises ``ProtocolError`` if the bytes are not ``what``."""
        from google.protobuf.message import DecodeError

        message = self.classes[name]()
        try:
            message.ParseFromString(data)
        except DecodeError as error:
            raise ProtocolError(f"{len(data)} bytes that are not {what}") from error
        return message

    @cached_property
    def classes(self) -> Mapping[str, Any]:
        """Message classes by name."""
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

        package = self._package
        file = descriptor_pb2.FileDescriptorProto(name=f"cellwatt/{package}.proto", package=package, syntax="proto2")
        for name, fields in self._table.items():
            message = file.message_type.add(name=name)
            for field, (number, kind) in fields.items():
                plain = kind.rstrip("*.")
                added = message.field.add(name=field, number=number, label=3 if kind.endswith("*") else 1)
                added.type = _SCALARS.get(plain, _MESSAGE)
                if plain not in _SCALARS:
                    added.type_name = f".{package}.{plain}"
                if kind.endswith("."):
                    if not message.oneof_decl:
                        message.oneof_decl.add(name="value")
                    added.oneof_index = 0
        pool = descriptor_pool.DescriptorPool()
        pool.Add(file)
        known = {name: pool.FindMessageTypeByName(f"{package}.{name}") for name in self._table}
        return {name: message_factory.GetMessageClass(found) for name, found in known.items()}
