"""I/O groups, registers and variables of an emulated controller; they can only be read.

Source: the read commands of the HSES manual 160766-1CD (FS100), as public clients send them.
"""

from __future__ import annotations

import struct

from cellwatt_drivers.yaskawa import wire

SIZES = {0x78: 1, 0x79: 2, 0x7A: 1, 0x7B: 2, 0x7C: 4, 0x7D: 4, 0x7E: 16, 0x7F: 52, 0x80: 36, 0x81: 36}
"""Command that reads one → bytes of it: I/O, register, B, I, D, R, S, P, BP and EX variable."""
_PLURAL = 0x288
"""The command that reads several is that much above the one that reads one."""
_COUNT = struct.Struct("<I")
_LONGEST = wire.LONGEST - wire.HEADER_SIZE - _COUNT.size

NO_COMMAND, NO_INSTANCE, BAD_SIZE = 0xA000, 0xA001, 0xB003


class Memory:
    """All of it is 0 but for ``values``: by command and number, as bytes."""

    def __init__(self) -> None:
        self.values: dict[tuple[int, int], bytes] = {}

    def one(self, command: int, number: int) -> bytes | None:
        """The value with this number; ``None`` where the command reads no memory."""
        size = SIZES.get(command)
        return None if size is None else self.values.get((command, number), bytes(size))

    def several(self, command: int, first: int, data: bytes) -> bytes | int:
        """Answer to a plural read: the count and the values from ``first`` on, or the added status of a refusal.

        What takes a byte is read in pairs.
        """
        single = command - _PLURAL
        size = SIZES.get(single)
        if size is None:
            return NO_COMMAND
        if len(data) != _COUNT.size:
            return BAD_SIZE
        (count,) = _COUNT.unpack(data)
        if not 0 < count <= _LONGEST // size or (size == 1 and count % 2):
            return BAD_SIZE
        numbers = range(first, first + count)
        return data + b"".join(self.values.get((single, n), bytes(size)) for n in numbers)
