"""Registers of a meter's values, and the requests that read them. Pure functions."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

RegisterType = Literal["int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"]
WordOrder = Literal["big", "little", "badc", "dcba"]

LONGEST = 125
"""Most registers in one request (Modbus Application Protocol V1.1b3, 6.3 and 6.4)."""

_FORMAT: dict[RegisterType, str] = {
    "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f",
    "float64": "d",
}  # fmt: skip


def width(kind: RegisterType) -> int:
    """Return the number of registers of a value."""
    return struct.calcsize(_FORMAT[kind]) // 2


@dataclass(frozen=True, slots=True)
class Slot:
    """One value: the ``address`` of its first register, as on the wire, and its ``column``."""

    address: int
    kind: RegisterType
    column: int

    @property
    def end(self) -> int:
        """Address after its last register."""
        return self.address + width(self.kind)


class Block:
    """Slots that one request reads; ``order`` is the order of words within a value, and of bytes within a word."""

    def __init__(self, slots: tuple[Slot, ...], order: WordOrder) -> None:
        self.slots = slots
        self.order = order
        self.address = slots[0].address
        self.count = max(s.end for s in slots) - self.address
        self.columns = [s.column for s in slots]
        self._words: list[int] = []
        for slot in slots:
            own = range(slot.address - self.address, slot.end - self.address)
            self._words += own if order in ("big", "badc") else reversed(own)
        self._packed = struct.Struct(f"{'>' if order in ('big', 'little') else '<'}{len(self._words)}H")
        self._values = struct.Struct(">" + "".join(_FORMAT[s.kind] for s in slots))

    def decode(self, registers: Sequence[int]) -> tuple[float, ...]:
        """Decode the slots' register numbers from ``count`` registers."""
        return self._values.unpack(self._packed.pack(*[registers[i] for i in self._words]))

    def encode(self, numbers: Sequence[float], registers: list[int], start: int) -> None:
        """Encode the slots' numbers into ``registers``, whose first has the address ``start``."""
        words = self._packed.unpack(self._values.pack(*numbers))
        for i, word in zip(self._words, words, strict=True):
            registers[self.address - start + i] = word

    def split(self) -> tuple[Block, ...]:
        """Smaller blocks: without registers between values, or else value by value; none for a single value."""
        if len(self.slots) == 1:
            return ()
        whole = plan(self.slots, LONGEST, 0, self.order)
        return whole if len(whole) > 1 else tuple(Block((slot,), self.order) for slot in self.slots)


def plan(slots: Iterable[Slot], longest: int, gap: int, order: WordOrder) -> tuple[Block, ...]:
    """Fewest requests of at most ``longest`` registers that read all slots, with gaps of at most ``gap`` registers."""
    blocks: list[list[Slot]] = []
    for slot in sorted(slots, key=lambda s: s.address):
        last = blocks[-1] if blocks else []
        if last and slot.address - last[-1].end <= gap and slot.end - last[0].address <= longest:
            last.append(slot)
        else:
            blocks.append([slot])
    return tuple(Block(tuple(b), order) for b in blocks)
