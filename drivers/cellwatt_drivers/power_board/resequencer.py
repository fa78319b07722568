"""Restores the order in which the board made the packets, and counts lost samples."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Literal

from cellwatt_drivers.power_board.payload import Packet

MOST_HELD = 64
"""Most packets that wait for an overtaken one; with more, the gap is skipped, so that memory is bounded."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A packet with its unwrapped ``sequence`` and board ``time`` (µs), and the cell's ``arrival`` (ns)."""

    packet: Packet
    sequence: int
    time: int
    arrival: int


class Resequencer:
    """Holds packets that overtook others for at most ``window`` ns; the first packet defines the start."""

    def __init__(self, window: int) -> None:
        self._window = window
        self._next: int | None = None
        self._held: dict[int, Placed] = {}
        self._given_up: deque[range] = deque(maxlen=MOST_HELD)

    def put(self, placed: Placed) -> Literal["", "reordered", "duplicates", "late"]:
        """Add a packet, unless it was received before (``duplicates``) or its gap was skipped (``late``)."""
        number = placed.sequence
        if self._next is None:
            self._next = number
        if number < self._next:
            return "late" if any(number in lost for lost in self._given_up) else "duplicates"
        if number in self._held:
            return "duplicates"
        overtaken = any(number < held for held in self._held)
        self._held[number] = placed
        return "reordered" if overtaken else ""

    @property
    def deadline(self) -> int | None:
        """The cell's time, ns, at which the gap before the waiting packets is skipped; ``None``: none wait."""
        return min(p.arrival for p in self._held.values()) + self._window if self._held else None

    def release(self, now: int, *, everything: bool = False) -> list[tuple[int, Placed]]:
        """Packets in order, each with the number of samples missing before it.

        Packets next in sequence are released at once; those behind a gap at its deadline, or with ``everything``.
        """
        if not self._held or self._next is None:
            return []
        crowded = everything or len(self._held) > MOST_HELD
        limit = max((n for n, p in self._held.items() if crowded or p.arrival + self._window <= now), default=-1)
        out: list[tuple[int, Placed]] = []
        for number in sorted(self._held):
            gap = number - self._next
            if gap > 0 and number > limit:
                break
            placed = self._held.pop(number)
            if gap > 0:
                self._given_up.append(range(self._next, number))
            out.append((max(gap, 0), placed))
            self._next = number + placed.packet.samples
        return out

    def restart(self) -> None:
        """Discard the numbering: the next packet defines the start."""
        self._next = None
        self._held.clear()
        self._given_up.clear()
