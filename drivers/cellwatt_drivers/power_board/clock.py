"""Unwraps a board's 16-bit sequence numbers and its 32-bit clock of microseconds.

At 123 Hz the sequence wraps every 532 s and the clock every 71.6 min, so each alone is ambiguous after an outage.
Together with the cell's time they are unique: the cell's time gives the turn of the clock, the clock gives the turn of
the sequence. A packet that fits neither means that the board restarted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from cellwatt.clock import unwrapped
from cellwatt_drivers.power_board.payload import SEQUENCE_WRAP, TIME_WRAP, Packet

EARLY = 1e6
"""Most by which a packet may be ahead of the least delayed one so far, µs: more means a new time base."""
DRIFT = 1e-3
"""Largest rate difference between the board's and the cell's clock during silence; crystals are far better."""
OLDEST = 60e6
"""Longest delay of a packet, µs (stalled link, buffered bytes); a longer one means a new time base."""
RECENT = 1024
"""Samples by which a duplicate or overtaken packet may be behind."""
MOST_BEHIND = 32
"""Consecutive packets behind that mean the board restarted shortly after its last start."""

Verdict = Literal["follows", "behind", "restarted"]


@dataclass(frozen=True, slots=True)
class PacketPosition:
    """Position of a packet on the unwrapped scales: ``sequence`` and ``time`` (µs) of its first sample.

    ``follows``: after the newest packet; ``behind``: before it; ``restarted``: its time base is another one.
    """

    sequence: int
    time: int
    verdict: Verdict


class BoardClock:
    """Sequence and clock of one board; ``rate`` (Hz) is used until two packets show the actual one."""

    def __init__(self, rate: float) -> None:
        self._nominal = 1e6 / rate
        self._period: float | None = None
        self._sequence: int | None = None
        self._time = 0
        self._arrival = 0.0
        self._ahead = 0.0
        self._behind = 0

    def place(self, packet: Packet, arrival: int) -> PacketPosition:
        """Return the position of a packet that arrived at the cell's time ``arrival``, ns."""
        now = arrival / 1e3
        if self._sequence is None:
            return self._start(packet, now, "follows")
        elapsed = now - self._arrival
        expected = now + self._ahead
        time = unwrapped(packet.time, TIME_WRAP, expected)
        span = time - self._time
        steps = self._steps(packet, span)
        if -EARLY - DRIFT * elapsed <= expected - time <= OLDEST and self._fits(steps, span):
            if steps > 0:
                return self._advance(packet, steps, time, now)
            return self._fall_behind(packet, PacketPosition(self._sequence + steps, time, "behind"), now)
        return self._start(packet, now, "restarted")

    def _steps(self, packet: Packet, span: float) -> int:
        """Samples from the newest to this one, given about how many µs lie between them."""
        assert self._sequence is not None
        expected = self._sequence + span / (self._period or self._nominal)
        return unwrapped(packet.sequence, SEQUENCE_WRAP, expected) - self._sequence

    def _fits(self, steps: int, span: float) -> bool:
        """True if ``steps`` samples take ``span`` µs; while the period is unknown, if they could."""
        if steps < -RECENT or (steps > 0) != (span > 0) or (steps < 0) != (span < 0):
            return False
        if self._period is None:
            return steps <= RECENT
        return abs(span - steps * self._period) <= 20e3 + 2 * self._period + 0.02 * abs(steps) * self._period

    def _advance(self, packet: Packet, steps: int, time: int, now: float) -> PacketPosition:
        assert self._sequence is not None
        if packet.step:
            self._period = float(packet.step)
        elif steps <= RECENT:
            seen = (time - self._time) / steps
            self._period = seen if self._period is None else self._period + (seen - self._period) / 16
        self._ahead = max(self._ahead - DRIFT * (now - self._arrival), time - now)
        self._sequence += steps
        self._time, self._arrival, self._behind = time, now, 0
        return PacketPosition(self._sequence, time, "follows")

    def _fall_behind(self, packet: Packet, place: PacketPosition, now: float) -> PacketPosition:
        self._behind += 1
        return place if self._behind < MOST_BEHIND else self._start(packet, now, "restarted")

    def _start(self, packet: Packet, now: float, verdict: Verdict) -> PacketPosition:
        """Make this packet the new origin of clock and sequence."""
        self._sequence = packet.sequence
        self._time, self._arrival, self._ahead = packet.time, now, packet.time - now
        self._period = float(packet.step) if packet.step else None
        self._behind = 0
        return PacketPosition(self._sequence, self._time, verdict)
