"""From one message's frames to samples."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING

from cellwatt.account import Losses
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Inlet
from cellwatt_drivers.can_sensor.sensor_map import Decoding
from cellwatt_drivers.shared.rows import Row, Rows

if TYPE_CHECKING:
    from can import Message

DUPLICATE = -1
_WINDOW = 16
"""Consecutive messages that must be behind before a loss visible only in the time is counted."""
_CREEP = 0.02
"""Share of a cycle by which a message may fall behind its predecessor without a loss: the sensor's clock is slow."""


class Cycle:
    """Detects losses of one message with period ``period`` s (0: unknown) and a counter of 0 … ``counts_to`` - 1.

    ``wraps_at``: as ``counts_to``, if the DBC file states fewer values; it holds until the counter has a higher one.
    ``shared``: the counter also counts frames of other pages, of which ``others`` came since the last message. How many
    of the missing ones are of this page is known from the time.

    The counter shows at once how many messages were lost, except for whole rounds of it. Those, and all losses of a
    message without a counter, show in the time: later messages stay behind. Messages that were only late (a stalled
    adapter or PC) catch up, and are not counted as lost.
    """

    def __init__(self, period: float, counts_to: int | None, wraps_at: int | None = None, shared: bool = False) -> None:
        self.others = 0
        self._period = period
        self._counts_to = counts_to
        self._wraps_at = wraps_at or counts_to or 1
        self._round = 1 if shared else self._wraps_at
        self._shared = shared
        self._start: float | None = None
        self._time = 0.0
        self._count = 0
        self._number = 0
        self._earliest = 0.0
        self._behind: deque[tuple[float, float]] = deque(maxlen=_WINDOW)  # (time, amount behind), cycles

    def lost(self, time: float, count: int, resumed: bool = False) -> int:
        """Return how many messages were lost before one made at ``time`` s with its counter at ``count``.

        ``resumed``: the bus was closed since the last message, so the time between the two counts at once.
        Returns ``DUPLICATE`` if the message repeats the last one.
        """
        if self._start is None:
            self._start = self._time = time
            self._count, self.others = count, 0
            return 0
        if self._counts_to is not None and count >= self._wraps_at:
            self._wraps_at = self._counts_to
            self._round = 1 if self._shared else self._counts_to
        cycles = (time - self._time) / self._period if self._period else 0.0
        step = (count - self._count) % self._wraps_at
        if step == 0:
            if self._counts_to is not None and cycles < self._wraps_at / 2:
                return DUPLICATE
            step = self._round
        if self._shared:
            missing = max(0, step - 1 - self.others)
            step = 1 + (min(missing, max(0, round(cycles) - 1)) if self._period else missing)
            self.others = 0
        self._time, self._count = time, count
        if resumed:
            step += self._round * max(0, round((cycles - step) / self._round))
        self._number += step
        return step - 1 + self._rounds(time - self._start, resumed)

    def _rounds(self, elapsed: float, resumed: bool) -> int:
        """Return the messages in whole rounds of the counter that were lost, as the time shows."""
        if not self._period:
            return 0
        now = elapsed / self._period
        offset = now - self._number
        if resumed:
            self._earliest = offset
            self._behind.clear()
        self._earliest = min(offset, self._earliest + _CREEP)
        self._behind.append((now, offset - self._earliest))
        if len(self._behind) < _WINDOW or now - self._behind[0][0] < _WINDOW / 2:
            return 0  # too few messages, or so fast that they are catching up
        lost = self._round * round(min(behind for _, behind in self._behind) / self._round)
        if lost:
            self._number += lost
            self._behind.clear()
        return lost


_QUALITY = {"clipped": Quality.CLIPPED, "missing": Quality.MISSING, "told": Quality.GOOD}
_BACK = 0.5
"""Step back of time stamps, or forward of the PC's clock against the cell's, s, that counts as a new time base."""
_BRACKET_EVERY = 1_000_000_000
"""Time between two comparisons of the PC's clock with the cell's, ns."""


class Intake:
    """Decodes the frames of one stream, counts lost ones, and reports flags when they change."""

    def __init__(self, name: str, decoding: Decoding, period: float, inlet: Inlet) -> None:
        self.stream = Stream(decoding.name, decoding.channels, 1 / period if period else 0.0, "device")
        self.last = 0
        """Time stamp of the newest frame, ns; 0: none yet."""
        self._name = name
        self._decoding = decoding
        self._inlet = inlet
        self._period = period
        self._cycle = self._new_cycle()
        self._losses = Losses(inlet.account, "disconnected")
        self._bracketed = 0
        self._ahead: int | None = None
        """Lead of the PC's clock over the cell's time, ns."""
        self._flags: frozenset[str] = frozenset()
        self._rows = Rows()

    @property
    def identifier(self) -> tuple[int, bool]:
        """The frame's identifier, and whether it is extended."""
        return self._decoding.message.frame_id, self._decoding.message.is_extended_frame

    def _new_cycle(self) -> Cycle:
        return Cycle(self._period, *self._decoding.counter)

    def resume(self) -> None:
        """Mark that the bus was opened again: frames missing now were lost while it was closed."""
        self._losses.resumed = True

    def take(self, frame: Message, arrival: int) -> None:
        """Take a frame of this message, received by the cell's time ``arrival``, ns."""
        try:
            signals = self._decoding.decode(bytes(frame.data))
        except ValueError as error:
            self._inlet.account.anomaly("malformed")
            if self._inlet.account.counters["malformed"] == 1:
                self._inlet.event("malformed_frame", f"{self._name}: {error}")
            return
        if not signals:  # a multiplexed message with another page
            self._inlet.account.count("frames without the signals")
            self._cycle.others += 1
            return
        wanted = self._decoding.wanted
        if len(signals) < len(wanted.needed):
            self._inlet.account.count("signals beyond a short frame", len(wanted.needed) - len(signals))
        if not self._rows:
            self._compare()
        count = int(signals[wanted.counter]) if wanted.counter else 0
        lost = self._cycle.lost(frame.timestamp, count, self._losses.resumed)
        if lost == DUPLICATE:
            self._inlet.account.anomaly("duplicates")
            return
        self._losses.before_next(lost)
        self._add(frame.timestamp, signals, arrival)

    def _add(self, timestamp: float, signals: Mapping[str, float], arrival: int) -> None:
        stamp = round(timestamp * 1e9)
        if stamp < self.last - _BACK * 1e9:
            self.flush(arrival)
            self._inlet.clock_reset(self.stream, f"the PC's clock was set back by {(self.last - stamp) / 1e9:.3f} s")
            self.last = 0
        self.last = max(stamp, self.last + 1)
        flags = frozenset(f for f in self._decoding.wanted.flags if signals[f])
        self._report(flags)
        quality = max((_QUALITY[self._decoding.wanted.flags[f]] for f in flags), default=Quality.GOOD)
        wanted = zip(self._decoding.wanted.signals, self._decoding.factors, strict=True)
        row = [signals.get(s, math.nan) * f for s, f in wanted]
        if quality is Quality.MISSING or all(map(math.isnan, row)):
            row, quality = [math.nan] * len(row), Quality.MISSING
        self._rows.append(Row(self.last, row, quality))

    def _report(self, flags: frozenset[str]) -> None:
        for flag in flags:
            self._inlet.account.count(f"flag {flag}")
        if flags != self._flags:
            text = f"raises {', '.join(sorted(flags))}" if flags else "raises no flags"
            self._inlet.event("sensor_flags", f"{self._name}: {self.stream.name} {text}")
            self._flags = flags

    def flush(self, arrival: int) -> None:
        """Hand over the samples since the last call, all received by the cell's time ``arrival``, ns."""
        self._rows.hand_over(self._inlet, self.stream, arrival)

    def _compare(self) -> None:
        """Bracket the PC's clock, which stamps the frames: a stamp read now is no earlier than the cell's time now."""
        not_before, stamp = self._inlet.now(), time.time_ns()
        before, self._ahead = self._ahead, stamp - not_before
        if before is not None and self._ahead - before > _BACK * 1e9:
            self._cycle = self._new_cycle()  # the old one would see all messages as behind
            self._inlet.clock_reset(self.stream, f"the PC's clock jumped by {(self._ahead - before) / 1e9:.3f} s")
        if not_before - self._bracketed >= _BRACKET_EVERY:
            self._bracketed = not_before
            self._inlet.bracket(self.stream, stamp, not_before)
