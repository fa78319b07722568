"""From published messages to samples: rows by time stamps, what did not change between them, and what was lost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cellwatt.account import Losses
from cellwatt.batch import Reading
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Inlet
from cellwatt_drivers.opc_ua.messages import Item, Message

_SECOND = 1_000_000_000
_BACK = 1 * _SECOND
"""ns that a value's time stamp may step back before the source's clock counts as set."""
_STRANGE = 1 * _SECOND
"""ns by which the source's time may run ahead of this PC's between two messages before its clock counts as set."""
_MOST_HELD = 1000
"""Unchanged samples told at once; more are counted as lost."""


@dataclass
class _Rows:
    """Samples of one message, not yet handed over."""

    times: list[int] = field(default_factory=list)
    values: list[list[float]] = field(default_factory=list)
    quality: list[int] = field(default_factory=list)

    def add(self, time: int, values: Sequence[float], quality: Quality) -> None:
        """Append a sample."""
        unknown = all(v != v for v in values)
        self.times.append(time)
        self.values.append(list(values))
        self.quality.append(Quality.MISSING if unknown else quality)

    def change(self, values: Sequence[float], quality: Quality) -> None:
        """Replace the last sample's values."""
        time = self.times.pop()
        self.values.pop()
        self.quality.pop()
        self.add(time, values, quality)


@dataclass(frozen=True, slots=True)
class _Base:
    """A time of the source, the server's time when it was published, and the cell's when it came, ns."""

    time: int
    published: int
    arrival: int


class Intake:
    """Takes the messages of one source in order, over all its connections, and keeps its account.

    A server tells a value when it changes. So a sample that nobody told and that no sign of loss concerns is one
    whose values are those before: it is handed over as such, up to the time of the last message, with the source's
    clock carried on by the server's. ``status_name`` gives the name of a status code.
    """

    def __init__(self, name: str, inlet: Inlet, stream: Stream, status_name: Callable[[int], str]) -> None:
        self.stream = stream
        self._name = name
        self._inlet = inlet
        self._status_name = status_name
        self._period = round(_SECOND / stream.rate)
        self._publishing = self._period
        self._losses = Losses(inlet.account)
        self._values = [float("nan")] * len(stream.channels)
        self._stamps = [0] * len(stream.channels)
        self._last: int | None = None
        self._arrival = 0
        self._base = _Base(0, 0, 0)
        self._sequence: int | None = None
        self._first = True
        self._bad: dict[int, int] = {}
        self._stale = False

    def resume(self, sampling: float, publishing: float) -> None:
        """A subscription was made anew, with these intervals in s: all values are told again."""
        self._period = max(round(_SECOND / self.stream.rate), round(sampling * _SECOND))
        self._publishing = max(self._period, round(publishing * _SECOND))
        self._losses.resumed = self._last is not None
        self._stamps = [0] * len(self._stamps)
        self._sequence = None
        self._first = True

    def take(self, message: Message, arrival: int) -> None:
        """Take a message that was read at the cell's time ``arrival``, ns."""
        if not message.published:  # some servers leave it out, at least in the first
            message = replace(message, published=arrival)
        lost = self._skipped(message)
        rows = _Rows()
        if not message.items:
            self._carry_on(rows, message.published, arrival)
        elif self._first:
            self._begin(rows, message, arrival)
        else:
            self._go_on(rows, message, arrival, lost)
        self._tell(message.items)
        self._hand_over(rows, arrival)

    def _skipped(self, message: Message) -> bool:
        """True if messages before this one never came."""
        expected = None if self._sequence is None else self._sequence % 0xFFFF_FFFF + 1
        missing = 0 if expected is None else (message.sequence - expected) % 0xFFFF_FFFF
        if message.items:
            self._sequence = message.sequence
        elif expected is None or missing:
            self._sequence = message.sequence - 1 or 0xFFFF_FFFF  # a sign of life has the number of the next one
        if not 0 < missing < 1 << 31:
            return False
        self._inlet.account.anomaly("lost messages", missing)
        return True

    def _begin(self, rows: _Rows, message: Message, arrival: int) -> None:
        """Take the first values: those that have not changed for long may carry an old time stamp."""
        self._first = False
        newest = max((i.stamp for i in message.items), default=0)
        time = newest
        if abs(message.published - newest) > _STRANGE + 2 * self._publishing:
            time = message.published
            if self._last is not None:
                time = self._base.time + message.published - self._base.published
        self._row(rows, time, message.items, arrival, "")
        self._base = _Base(self._last or time, message.published, arrival)

    def _go_on(self, rows: _Rows, message: Message, arrival: int, lost: bool) -> None:
        fresh, stale = self._sorted(message.items)
        reason = "gap" if lost else ""
        while fresh:
            together = self._together(fresh)
            fresh = fresh[len(together) :]
            self._row(rows, together[-1].stamp, together, arrival, reason)
            reason = ""
        if rows.times:
            self._base = _Base(rows.times[-1], message.published, arrival)
        if stale:
            self._take_stale(rows, stale, message, arrival)
        self._stale = bool(stale)

    def _sorted(self, items: Sequence[Item]) -> tuple[list[Item], list[Item]]:
        """Return items by time stamps, and those whose time stamp is of no use: it is not newer than the value's last.

        One that steps back by much is that of a clock that was set.
        """
        newest = list(self._stamps)
        fresh, stale = [], []
        for item in items:
            last = newest[item.column]
            if item.stamp > last or 0 < item.stamp < last - _BACK:
                fresh.append(item)
                newest[item.column] = item.stamp
            else:
                stale.append(item)
        return sorted(fresh, key=lambda i: i.stamp), stale

    def _together(self, items: Sequence[Item]) -> list[Item]:
        """Return the first of these that make one sample: within half a period, each column once."""
        columns: set[int] = set()
        found = []
        for item in items:
            if item.column in columns or item.stamp - items[0].stamp > self._period // 2:
                break
            columns.add(item.column)
            found.append(item)
        return found

    def _row(self, rows: _Rows, time: int, items: Sequence[Item], arrival: int, reason: str) -> None:
        """Take the values of one moment, after those of the moments before it that nobody told."""
        if self._last is not None and self._is_strange(time, arrival):
            self._hand_over(rows, arrival)
            self._inlet.clock_reset(self.stream, f"its time stamps jumped by {(time - self._last) / 1e9:+.3f} s")
            self._last = None
            self._losses.resumed = False
        overflow = sum(i.overflow for i in items)
        self._inlet.account.anomaly("overflows", overflow)
        if self._last is not None:
            if time <= self._last:
                self._inlet.account.count("out of order")
                time = self._last + 1
            self._between(rows, time, "overflow" if overflow else reason)
        for item in items:
            self._values[item.column] = item.value
            self._stamps[item.column] = item.stamp
        self._add(rows, time, Quality.GOOD)
        self._arrival = arrival

    def _is_strange(self, time: int, arrival: int) -> bool:
        assert self._last is not None
        passed = time - self._last
        return passed < -_BACK or passed - (arrival - self._arrival) > _STRANGE + 2 * self._publishing

    def _between(self, rows: _Rows, time: int, reason: str) -> None:
        """Samples between the last one and ``time``: lost for a reason, or unchanged."""
        assert self._last is not None
        missing = round((time - self._last) / self._period) - 1
        if self._losses.resumed:
            self._losses.before_next(max(0, missing))
        elif missing > 0 and (reason or missing > _MOST_HELD):
            self._inlet.account.lose(missing, reason or "gap")
        elif missing > 0:
            step = (time - self._last) / (missing + 1)
            start = self._last
            self._inlet.account.count("unchanged", missing)
            for k in range(1, missing + 1):
                self._add(rows, start + round(k * step), Quality.GOOD)

    def _carry_on(self, rows: _Rows, published: int, arrival: int) -> None:
        """Nothing changed up to a sign of life."""
        if self._last is None or self._first or (until := self._until(published, arrival)) is None:
            return
        held = (until - self._last) // self._period
        if held > 0:
            last = self._last + held * self._period
            self._between(rows, last + self._period, "")
            self._last = last
            self._arrival = arrival

    def _until(self, published: int, arrival: int) -> int | None:
        """Carry the source's clock on by the server's; ``None`` where that was set."""
        assert self._last is not None
        passed = published - self._base.published
        if abs(passed - (arrival - self._base.arrival)) > _STRANGE + 2 * self._publishing:
            self._base = _Base(self._last, published, arrival)
            return None
        self._base = _Base(self._base.time + passed, published, arrival)
        return self._base.time

    def _take_stale(self, rows: _Rows, items: Sequence[Item], message: Message, arrival: int) -> None:
        """Take values whose time stamps did not rise as of the time of their publication."""
        self._inlet.account.anomaly("stale time stamps", len(items))
        if not self._stale:
            names = ", ".join(sorted({self.stream.names[i.column] for i in items}))
            self._inlet.event("stale_time", f"{self._name}: the time stamps of {names} do not rise; taken as published")
        until = self._last if self._last is None or rows.times else self._until(message.published, arrival)
        if self._last is not None and until is not None and not rows.times:
            self._between(rows, until, "")
        for item in items:
            self._values[item.column] = item.value
        if rows.times and until == self._last:
            rows.change(self._values, Quality.LATE)
        elif self._last is not None:
            self._add(rows, max(until or 0, self._last + 1), Quality.LATE)
            self._arrival = arrival

    def _add(self, rows: _Rows, time: int, quality: Quality) -> None:
        rows.add(time, self._values, quality)
        self._last = time

    def _tell(self, items: Sequence[Item]) -> None:
        """Count what the server says of its values, and report each change of what is bad."""
        account = self._inlet.account
        account.anomaly("bad status", sum(i.bad for i in items))
        account.anomaly("malformed", sum(i.malformed for i in items))
        if uncertain := sum(i.uncertain for i in items):
            account.count("uncertain", uncertain)
        before = dict(self._bad)
        for item in items:
            if item.bad:
                account.count(f"status {self._status_name(item.status)}")
                self._bad[item.column] = item.status
            else:
                self._bad.pop(item.column, None)
        if self._bad.keys() != before.keys():
            told = ", ".join(f"{self.stream.names[c]} {self._status_name(s)}" for c, s in sorted(self._bad.items()))
            self._inlet.event("bad_status", f"{self._name}: {told or 'all values are good again'}", channels=told)

    def _hand_over(self, rows: _Rows, arrival: int) -> None:
        if not rows.times:
            return
        self._inlet.account.expect(len(rows.times))
        self._inlet.emit(
            Reading(
                self.stream,
                np.array(rows.values),
                arrival,
                device_time=np.array(rows.times, dtype=np.int64),
                quality=np.array(rows.quality, dtype=np.uint8),
            )
        )
        rows.times, rows.values, rows.quality = [], [], []
