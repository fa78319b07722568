"""As much of Protocol Buffers as a recording needs: the description of one flat message, and tags.

A channel's message type is known only at run time, so its FileDescriptorSet is written by hand: a few
bytes a field (google/protobuf/descriptor.proto), which spares the daemon the protobuf library.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

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
    # Said outright, so that names that differ in underscores only do not clash in camel case.
    return parts + _text(10, field.name)


def file_descriptor_set(package: str, message: str, fields: Iterable[Field]) -> bytes:
    """A serialised FileDescriptorSet with one proto2 message in one file."""
    body = _text(1, message) + b"".join(_text(2, _field(f)) for f in fields)
    file = _text(1, f"{package}/{message}.proto") + _text(2, package) + _text(4, body)
    return _text(1, file)


def identifier(name: str) -> str:
    """A name as Protocol Buffers allow it: ``joint_1.position`` becomes ``joint_1_position``."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return plain if plain[:1].isalpha() else f"_{plain}"


def identifiers(names: Sequence[str], taken: Iterable[str] = ()) -> tuple[str, ...]:
    """Identifiers of all names, made unique among themselves and ``taken`` by a number at the end."""
    used = set(taken)
    out: list[str] = []
    for name in names:
        plain, n = identifier(name), 1
        unique = plain
        while unique in used:
            n += 1
            unique = f"{plain}_{n}"
        used.add(unique)
        out.append(unique)
    return tuple(out)
