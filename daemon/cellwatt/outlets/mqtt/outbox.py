"""Entries that wait for the broker: bounded queues of new entries, and the back-fill from the record."""

from __future__ import annotations

import asyncio
import math
import time
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

import numpy as np

from cellwatt.account import Account
from cellwatt.channel import Quality
from cellwatt.errors import RecordingError, why
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.past import Archived, RecordedSpan, read
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.results import Event, Prediction, Result

PART: Final = 500
"""Most rows read from the record at a time."""
PIECE: Final = 16
"""Most back-filled results, or rows, that are sent together and confirmed as one."""
BLOCKS: Final = 4
"""A full queue owes one in so many of its rows at once: single rows between sent ones would be sent twice, as a cursor
has few spans."""
PAUSE: Final = 1.0
"""Time, s, before the record is read again if it does not reach the end of the span yet."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Waiting(Generic[T]):
    """A waiting item; ``late``: made without a connection. ``before``: time of the previous row, UTC ns."""

    item: T
    late: bool
    before: int = 0


class Outbox:
    """Queues of ``most`` entries each; a full queue drops its oldest entry and counts it.

    With a ``cursor``, the oldest row of a full queue is owed from the record; rows made without a connection are owed,
    too, and passed only to ``missed``.
    ``wake`` is set when there is something to send.
    """

    def __init__(
        self, selection: Selection, most: int, account: Account, cursor: Cursor | None, missed: Callable[[Row], None]
    ) -> None:
        self.rows: deque[Waiting[Row]] = deque()
        self.results: deque[Waiting[Result | Event]] = deque()
        self.predictions: deque[tuple[str, Mapping[str, str], Row]] = deque()
        """(name of the model, units of its outputs, row of its outputs)."""
        self.units: Mapping[str, str] | None = None
        """Units of the rows' channels, until they are published."""
        self.unmatched: tuple[str, ...] = ()
        self.last: int | None = None
        """Time of the last row, UTC ns."""
        self.begun = 0
        """Start of the span of the first row, UTC ns, once there is one."""
        self.wake = asyncio.Event()
        self.serving = False
        """True while the connection delivers what is sent."""
        every = selection.model_copy(update={"channels": ("*",)})
        self._most = most
        self._account = account
        self._cursor = cursor
        self._missed = missed
        self._picker = Picker(selection)
        self._models: defaultdict[str, Picker] = defaultdict(lambda: Picker(every))

    def leave(self) -> None:
        """Stop serving: owe the waiting rows from the record, if there is one."""
        self.serving = False
        if self._cursor is not None:
            for row in self.rows:
                self._leave(self._cursor, row)
            self.rows.clear()
        self.rows = deque(replace(row, late=True) for row in self.rows)
        self.results = deque(replace(result, late=True) for result in self.results)
        self._dropped("predictions", len(self.predictions))
        self.predictions.clear()

    def again(self, entry: Waiting[Any]) -> None:
        """Requeue an entry that may not have arrived: owe a row from the record, else put the entry first."""
        is_row = isinstance(entry.item, Row)
        if is_row and self._cursor is not None:
            self._owe(self._cursor, entry)
            return
        queue: deque[Any] = self.rows if is_row else self.results
        if len(queue) < self._most:
            queue.appendleft(replace(entry, late=True))
        else:
            self._dropped("rows" if is_row else "results", 1)

    def succeed(self, before: Outbox) -> None:
        """Take over the waiting entries of the previous outbox."""
        self._account.expect(len(before.rows))
        self._account.owed += len(before.rows)
        self.results.extendleft(reversed(before.results))
        self.rows.extendleft(reversed(before.rows))
        self.last, self.begun = before.last, before.begun

    def frames(self, frames: Frames) -> None:
        """Queue the rows of frames."""
        picker, before = self._picker, self._picker.layout
        for row in picker.rows(frames):
            self._row(row)
        if picker.layout is not before:
            self.unmatched, self.units = picker.unmatched, picker.units
            self.wake.set()

    def _row(self, row: Row) -> None:
        if self.last is None:
            self.begun = self.last = row.time - self._picker.span
        waiting = Waiting(row, not self.serving, self.last)
        self.last = row.time
        self._account.expect()
        self._account.owed += 1
        if waiting.late and self._cursor is not None:
            self._leave(self._cursor, waiting)
            return
        if self._cursor is not None and len(self.rows) >= self._most:
            for _ in range(math.ceil(self._most / BLOCKS)):
                self._leave_unseen(self._cursor, self.rows.popleft())
        self._put(self.rows, waiting, "rows")

    def prediction(self, item: Prediction) -> None:
        """Queue the rows of a model's output while serving."""
        if not self.serving:
            self._dropped("predictions", 1)
            return
        picker = self._models[item.model]
        for row in picker.rows(_as_frames(item, self._picker.layout.rate)):
            self._put(self.predictions, (item.model, picker.units, row), "predictions")

    def result(self, item: Result | Event) -> None:
        """Queue a result or event."""
        self._put(self.results, Waiting(item, not self.serving), "results")

    def _put(self, queue: deque[T], entry: T, what: str) -> None:
        if len(queue) >= self._most:
            queue.popleft()
            self._dropped(what, 1)
        queue.append(entry)
        self.wake.set()

    def _dropped(self, what: str, count: int) -> None:
        if count:
            self._account.count(f"{what} dropped", count)
        if count and what == "rows":
            self._account.owed -= count
            self._account.drop(count, "queue")

    def _leave(self, cursor: Cursor, row: Waiting[Row]) -> None:
        self._leave_unseen(cursor, row)
        self._missed(row.item)

    def _leave_unseen(self, cursor: Cursor, row: Waiting[Row]) -> None:
        """Owe a row; current values stay those of the last row sent, so that the next row has all changes."""
        self._owe(cursor, row)
        self._account.count("rows left to the record")

    def _owe(self, cursor: Cursor, row: Waiting[Row]) -> None:
        self._account.owed -= 1
        cursor.owe(row.before, row.item.time, 1)


def _as_frames(item: Prediction, rate: float) -> Frames:
    """A model's output as frames."""
    channels = tuple(FrameChannel(name, item.units[name], "continuous", "hold") for name in item.outputs)
    values = np.array([item.outputs[c.name] for c in channels], np.float64).reshape(len(channels), len(item.time)).T
    quality = np.where(np.isfinite(values), Quality.GOOD, Quality.MISSING).astype(np.uint8)
    time = np.array(item.time, np.int64)
    return Frames(Layout(channels, rate), item.sequence, time, values, quality, np.zeros(values.shape, np.int64))


class Backfill:
    """Reads owed rows and results from the ``record`` of a cell, span by span; ``problem``: why it cannot, or ``None``.

    ``piece``: results and rows that may be sent now, and the function to call once they have arrived.
    """

    def __init__(
        self, settings: MqttSettings, record: tuple[Path, str], cursor: Cursor, outbox: Outbox, account: Account
    ) -> None:
        self.problem: str | None = None
        self.piece: tuple[list[Archived], list[Row], Callable[[bool], None]] | None = None
        self._settings, self._record = settings, record
        self._cursor, self._outbox, self._account = cursor, outbox, account
        self._delivered = asyncio.Event()

    async def run(self) -> None:
        """Read, and provide piece by piece, until cancelled."""
        while True:
            await self._cursor.lacking.wait()
            gap = self._cursor.first
            if gap is None or not self._outbox.serving or self._outbox.last is None or await self._fill(*gap):
                await asyncio.sleep(PAUSE)

    async def _fill(self, after: int, until: int) -> bool:
        """Deliver one section of a span, results first; true if the record does not reach its end yet."""
        span = await self._read(after, until)
        for first in range(0, len(span.results), PIECE):
            await self._bring(span.results[first : first + PIECE], [], after, after)
        for first in range(0, max(len(span.rows), 1), PIECE):
            rows = span.rows[first : first + PIECE]
            due = time.monotonic() + len(rows) / self._settings.backfill
            end = rows[-1].time if first + PIECE < len(span.rows) else span.until
            await self._bring([], rows, after, end)
            after = end
            await asyncio.sleep(max(due - time.monotonic(), 0.0))
        return span.waits

    async def _bring(self, results: list[Archived], rows: list[Row], after: int, end: int) -> None:
        self._delivered.clear()
        self.piece = results, rows, partial(self._arrived, after, end, len(results), len(rows))
        self._outbox.wake.set()
        await self._delivered.wait()

    def _arrived(self, after: int, end: int, results: int, rows: int, refused: bool) -> None:
        for what, count in (("results", results), ("rows", rows)):
            if count:
                self._account.count(f"{what} {'refused' if refused else 'back-filled'}", count)
        self._account.miss(rows * refused, "refused")
        self._account.receive(rows * (not refused))
        self._cursor.pay(after, end, rows)
        self._delivered.set()

    async def _read(self, after: int, until: int) -> RecordedSpan:
        before = after < self._outbox.begun  # results from before this start were not in the queue
        until = min(until, self._outbox.begun) if before else until
        work = partial(read, *self._record, self._settings, after, until, PART, results=before)
        try:
            span = await asyncio.to_thread(work)
        except (OSError, RecordingError) as error:
            reason = why(error) if isinstance(error, OSError) else str(error)
            self.problem = f"record.folder {self._record[0]} cannot be read for back-fill: {reason}"
            self._account.count("record unreadable")
            return RecordedSpan(after, waits=True)
        self.problem = None
        return span
