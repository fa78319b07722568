"""From published messages to samples: rows by time stamp, unchanged samples between them, and losses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from cellwatt.account import Losses
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Inlet
from cellwatt_drivers.opc_ua.messages import Item, Message, status_name
from cellwatt_drivers.shared.rows import Row, Rows

_SECOND = 1_000_000_000
_BACK = 1 * _SECOND
"""Step back of a value's time stamp, ns, from which on the source's clock counts as reset."""
_STRANGE = 1 * _SECOND
"""Lead of the source's time over this PC's between two messages, ns, from which on its clock counts as reset."""
_MOST_HELD = 1000
"""Most unchanged samples filled in at once; more are counted as lost."""


@dataclass(frozen=True, slots=True)
class _Base:
    """A time of the source, the server's time of its publication, and the cell's time of its arrival, ns."""

    time: int
    published: int
    arrival: int


class Intake:
    """Takes the messages of one source in order, over all its connections, and counts them in its account.

    A server publishes a value when it changes. So a sample that was not published, without any sign of a loss, has the
    previous values: it is filled in with them, up to the time of the last message, with the source's clock extrapolated
    by the server's.
    """

    def __init__(self, name: str, inlet: Inlet, stream: Stream) -> None:
        self.stream = stream
        self._name = name
        self._inlet = inlet
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
        self._stale: set[int] = set()
        self._now = 0
        self._rows = Rows()

    def resume(self, sampling: float, publishing: float) -> None:
        """Begin a new subscription, with these intervals in s: the server publishes all values again."""
        self._period = max(round(_SECOND / self.stream.rate), round(sampling * _SECOND))
        self._publishing = max(self._period, round(publishing * _SECOND))
        self._losses.resumed = self._last is not None
        self._stamps = [0] * len(self._stamps)
        self._sequence = None
        self._first = True

    def take(self, message: Message, arrival: int) -> None:
        """Take a message that arrived at the cell's time ``arrival``, ns."""
        self._now = arrival
        if not message.published:  # some servers omit the time, at least in the first message
            message = replace(message, published=arrival)
        lost = self._skipped(message)
        if not message.items:
            self._carry_on(message.published)
        elif self._first:
            self._begin(message)
        else:
            self._go_on(message, "gap" if lost else "")
        self._report(message.items)
        self._rows.hand_over(self._inlet, self.stream, arrival)

    def _skipped(self, message: Message) -> bool:
        """True if messages before this one are missing."""
        expected = None if self._sequence is None else self._sequence % 0xFFFF_FFFF + 1
        missing = 0 if expected is None else (message.sequence - expected) % 0xFFFF_FFFF
        if message.items:
            self._sequence = message.sequence
        elif expected is None or missing:
            self._sequence = message.sequence - 1 or 0xFFFF_FFFF  # a keep-alive has the number of the next message
        if not 0 < missing < 1 << 31:
            return False
        self._inlet.account.anomaly("lost messages", missing)
        return True

    def _begin(self, message: Message) -> None:
        """Take the first values; values that have not changed for long may carry an old time stamp."""
        self._first = False
        time = max(i.stamp for i in message.items)
        if abs(message.published - time) > _STRANGE + 2 * self._publishing:
            time = message.published
            if self._last is not None:
                time += self._base.time - self._base.published
        self._row(time, message.items, "")
        self._base = _Base(self._last or time, message.published, self._now)

    def _go_on(self, message: Message, reason: str) -> None:
        fresh, stale = self._sorted(message.items)
        while fresh:
            together = self._together(fresh)
            fresh = fresh[len(together) :]
            self._row(together[-1].stamp, together, reason)
            reason = ""
        if self._rows:
            self._base = _Base(self._rows[-1].time, message.published, self._now)
        if stale:
            self._take_stale(stale, message.published)

    def _sorted(self, items: Sequence[Item]) -> tuple[list[Item], list[Item]]:
        """Return items by time stamp, and items with a useless stamp: one that is not newer than the tag's last stamp.

        A stamp that steps back by more than ``_BACK`` is valid: the source's clock was reset.
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
        """Return the first items that make one sample: within half a period, each column once."""
        columns: set[int] = set()
        found = []
        for item in items:
            if item.column in columns or item.stamp - items[0].stamp > self._period // 2:
                break
            columns.add(item.column)
            found.append(item)
        return found

    def _row(self, time: int, items: Sequence[Item], reason: str) -> None:
        """Take the values of one time, after filling in or counting the samples before it."""
        if self._last is not None and self._jumped(time - self._last):
            self._rows.hand_over(self._inlet, self.stream, self._now)
            self._inlet.clock_reset(self.stream, f"its time stamps jumped by {(time - self._last) / 1e9:+.3f} s")
            self._last = None
            self._losses.resumed = False
        overflow = sum(i.overflow for i in items)
        self._inlet.account.anomaly("overflows", overflow)
        if self._last is not None:
            if time <= self._last:
                self._inlet.account.count("out of order")
                time = self._last + 1
            self._between(time, "overflow" if overflow else reason)
        for item in items:
            self._values[item.column] = item.value
            self._stamps[item.column] = item.stamp
            self._stale.discard(item.column)
        self._add(time)

    def _jumped(self, passed: int) -> bool:
        """True if the source's clock was reset, given that its time stamps advanced by ``passed`` ns."""
        ahead, most = passed - (self._now - self._arrival), _STRANGE + 2 * self._publishing
        # The first values of a subscription have not waited, but may have changed that long before.
        return passed < -_BACK or ahead > most or (self._losses.resumed and ahead < -2 * most)

    def _between(self, time: int, reason: str) -> None:
        """Handle the samples between the last one and ``time``: lost for a reason, or unchanged."""
        assert self._last is not None
        start, missing = self._last, round((time - self._last) / self._period) - 1
        if self._losses.resumed:
            self._losses.before_next(max(0, missing))
        elif missing > 0 and (reason or missing > _MOST_HELD):
            self._inlet.account.lose(missing, reason or "gap")
        elif missing > 0:
            self._inlet.account.count("unchanged", missing)
            for k in range(1, missing + 1):
                self._add(start + round(k * (time - start) / (missing + 1)))

    def _carry_on(self, published: int) -> None:
        """Fill in unchanged samples up to a keep-alive message."""
        if self._last is None or self._first or (until := self._until(published)) is None:
            return
        held = (until - self._last) // self._period
        if held > 0:
            last = self._last + held * self._period
            self._between(last + self._period, "")
            self._last, self._arrival = last, self._now

    def _until(self, published: int) -> int | None:
        """Extrapolate the source's clock by the server's; ``None`` if the server's clock was reset."""
        assert self._last is not None
        passed = published - self._base.published
        if abs(passed - (self._now - self._base.arrival)) > _STRANGE + 2 * self._publishing:
            self._base = _Base(self._last, published, self._now)
            return None
        self._base = _Base(self._base.time + passed, published, self._now)
        return self._base.time

    def _take_stale(self, items: Sequence[Item], published: int) -> None:
        """Take values whose time stamps did not rise; they get the time of their publication."""
        assert self._last is not None
        self._inlet.account.anomaly("stale time stamps", len(items))
        if new := {i.column for i in items} - self._stale:
            self._stale |= new
            names = ", ".join(sorted(self.stream.names[column] for column in new))
            self._inlet.event("stale_time", f"{self._name}: time stamps of {names} do not rise; publication time used")
        if self._rows:
            time = self._rows.pop().time
        else:
            until = self._until(published)
            if until is not None:
                self._between(until, "")
            time = max(until or 0, self._last + 1)
        for item in items:
            self._values[item.column] = item.value
        self._add(time, Quality.LATE)

    def _add(self, time: int, quality: Quality = Quality.GOOD) -> None:
        unknown = all(math.isnan(v) for v in self._values)
        self._rows.append(Row(time, list(self._values), Quality.MISSING if unknown else quality))
        self._last, self._arrival = time, self._now

    def _report(self, items: Sequence[Item]) -> None:
        """Count the statuses of the values, and report each change of the set of bad ones."""
        account = self._inlet.account
        account.anomaly("bad status", sum(i.bad for i in items))
        account.anomaly("malformed", sum(i.malformed for i in items))
        if uncertain := sum(i.uncertain for i in items):
            account.count("uncertain", uncertain)
        before = dict(self._bad)
        for item in items:
            if item.bad:
                account.count(f"status {status_name(item.status)}")
                self._bad[item.column] = item.status
            else:
                self._bad.pop(item.column, None)
        if self._bad.keys() != before.keys():
            listed = ", ".join(f"{self.stream.names[c]} {status_name(s)}" for c, s in sorted(self._bad.items()))
            self._inlet.event("bad_status", f"{self._name}: {listed or 'all values are good again'}", channels=listed)
