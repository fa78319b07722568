"""The mark in the Zenoh attachment of every message. Pure."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from cellwatt.errors import ProtocolError

_MARK = struct.Struct("<BBHIqqq")
_CHECK = struct.Struct("<I")
_VERSION: Final = 1
_WITH_SCHEMA: Final = 2
_BACKFILL: Final = 1


Positions = Mapping[str, tuple[int, int]]
"""Session and next number by topic."""


@dataclass(frozen=True, slots=True)
class Mark:
    """The position of a message: samples ``sequence`` … ``sequence + count`` of its topic in ``session``.

    ``arrival`` is the cell's time, UTC ns, when the (last) block was read or the result was known. ``schema`` is the
    CRC-32 of the Arrow schema that the payload lacks; 0 if it lacks none. As bytes, little-endian:
    u8 version = 1, u8 flags (bit 0: backfill), u16 = 0, u32 count, i64 session, i64 sequence, i64 arrival; in
    version 2 u32 schema; u32 CRC-32 of the bytes so far and the payload after them.
    """

    session: int
    sequence: int
    count: int
    arrival: int
    backfill: bool = False
    schema: int = 0

    @property
    def end(self) -> int:
        """Number of the sample after the last one."""
        return self.sequence + self.count

    def encode(self, payload: bytes) -> bytes:
        """The attachment of a message with this payload."""
        flags = _BACKFILL if self.backfill else 0
        version = _WITH_SCHEMA if self.schema else _VERSION
        head = _MARK.pack(version, flags, 0, self.count, self.session, self.sequence, self.arrival)
        if self.schema:
            head += _CHECK.pack(self.schema)
        return head + _CHECK.pack(zlib.crc32(payload, zlib.crc32(head)))

    @classmethod
    def decode(cls, data: bytes, payload: bytes) -> Mark:
        """Decode a message's attachment. Raises ``ProtocolError`` if it is no mark or does not match the payload."""
        bare = data[:1] == bytes([_WITH_SCHEMA])
        size = _MARK.size + _CHECK.size * bare
        if len(data) < size + _CHECK.size or data[0] not in (_VERSION, _WITH_SCHEMA):
            raise ProtocolError(f"a message's attachment is not a cellwatt mark of version 1 or 2: {data[:8].hex()}")
        if zlib.crc32(payload, zlib.crc32(data[:size])) != _CHECK.unpack_from(data, size)[0]:
            raise ProtocolError("a message was damaged on its way: its checksum is not that of its content")
        _, flags, _, count, session, sequence, arrival = _MARK.unpack_from(data)
        schema = _CHECK.unpack_from(data, _MARK.size)[0] if bare else 0
        return cls(session, sequence, count, arrival, bool(flags & _BACKFILL), schema)
