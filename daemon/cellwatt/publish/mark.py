"""The mark that travels with every message as its Zenoh attachment. Pure."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

from cellwatt.errors import ProtocolError

_MARK = struct.Struct("<BBHIqqq")
_VERSION: Final = 1
_BACKFILL: Final = 1


@dataclass(frozen=True, slots=True)
class Mark:
    """Where a message stands: samples ``sequence`` … ``sequence + count`` of its topic in ``session``.

    ``arrival`` is the cell's time, UTC ns, when the (last) block was read or the result was known. As bytes,
    little-endian, 32 of them: u8 version = 1, u8 flags (bit 0: backfill), u16 = 0, u32 count, i64 session,
    i64 sequence, i64 arrival.
    """

    session: int
    sequence: int
    count: int
    arrival: int
    backfill: bool = False

    @property
    def end(self) -> int:
        """Number of the sample after the last."""
        return self.sequence + self.count

    def encode(self) -> bytes:
        """The attachment of a message."""
        flags = _BACKFILL if self.backfill else 0
        return _MARK.pack(_VERSION, flags, 0, self.count, self.session, self.sequence, self.arrival)

    @classmethod
    def decode(cls, data: bytes) -> Mark:
        """Read an attachment. Raises ``ProtocolError`` where it is none of ours."""
        if len(data) < _MARK.size or data[0] != _VERSION:
            raise ProtocolError(
                f"a message's attachment is not a cellwatt mark of version {_VERSION}: {data[:8].hex()}"
            )
        _, flags, _, count, session, sequence, arrival = _MARK.unpack_from(data)
        return cls(session, sequence, count, arrival, bool(flags & _BACKFILL))
