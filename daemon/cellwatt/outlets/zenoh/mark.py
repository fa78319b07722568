"""The mark that travels with every message as its Zenoh attachment. Pure."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Final

from cellwatt.errors import ProtocolError

_MARK = struct.Struct("<BBHIqqq")
_CHECK = struct.Struct("<I")
_VERSION: Final = 1
_BACKFILL: Final = 1


@dataclass(frozen=True, slots=True)
class Mark:
    """The place of a message: samples ``sequence`` … ``sequence + count`` of its topic in ``session``.

    ``arrival`` is the cell's time, UTC ns, when the (last) block was read or the result was known. As bytes,
    little-endian, 36 of them: u8 version = 1, u8 flags (bit 0: backfill), u16 = 0, u32 count, i64 session,
    i64 sequence, i64 arrival, u32 CRC-32 of these 32 bytes and the payload after them.
    """

    session: int
    sequence: int
    count: int
    arrival: int
    backfill: bool = False

    @property
    def end(self) -> int:
        """Number of the sample after the last one."""
        return self.sequence + self.count

    def encode(self, payload: bytes) -> bytes:
        """The attachment of a message with this payload."""
        flags = _BACKFILL if self.backfill else 0
        head = _MARK.pack(_VERSION, flags, 0, self.count, self.session, self.sequence, self.arrival)
        return head + _CHECK.pack(zlib.crc32(payload, zlib.crc32(head)))

    @classmethod
    def decode(cls, data: bytes, payload: bytes) -> Mark:
        """Decode the attachment of a message. Raises ``ProtocolError`` if it is no mark, or does not match the payload.

        Older cells send no checksum; their marks are accepted.
        """
        if len(data) < _MARK.size or data[0] != _VERSION:
            raise ProtocolError(
                f"a message's attachment is not a cellwatt mark of version {_VERSION}: {data[:8].hex()}"
            )
        head = data[: _MARK.size]
        if len(data) >= _MARK.size + _CHECK.size:
            (said,) = _CHECK.unpack_from(data, _MARK.size)
            if zlib.crc32(payload, zlib.crc32(head)) != said:
                raise ProtocolError("a message was damaged on its way: its checksum is not that of its content")
        _, flags, _, count, session, sequence, arrival = _MARK.unpack(head)
        return cls(session, sequence, count, arrival, bool(flags & _BACKFILL))
