"""What waits for the broker: rows, results and predictions, each bounded; made of what the cell gives."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from cellwatt.account import Account
from cellwatt.channel import Quality
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.mqtt.message import Labels
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.results import Event, Prediction, Result

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Live:
    """A row, the time of the one before it, and true if nobody could hear it when it was made."""

    row: Row
    before: int
    late: bool


@dataclass(frozen=True, slots=True)
class Told:
    """A result or event, and true if nobody could hear it when it was made."""

    item: Result | Event
    late: bool


@dataclass(frozen=True, slots=True)
class Foreseen:
    """A row of a model's outputs."""

    model: str
    units: Mapping[str, str]
    row: Row


class Outbox:
    """Queues of ``most`` entries each; where one is full, its oldest is dropped and counted.

    With a ``cursor`` over the record, rows that nobody hears are owed from there, and given to ``missed`` alone.
    ``wake`` is set when there is something to send.
    """

    def __init__(
        self, selection: Selection, most: int, account: Account, cursor: Cursor | None, missed: Callable[[Row], None]
    ) -> None:
        self.rows: deque[Live] = deque()
        self.results: deque[Told] = deque()
        self.predictions: deque[Foreseen] = deque()
        self.labels: Labels | None = None
        """Channels of the rows, until they are taken."""
        self.unmatched: tuple[str, ...] = ()
        self.last: int | None = None
        """Time of the last row that was made, ns."""
        self.begun = 0
        """Time after which rows were made, ns, once there is one."""
        self.wake = asyncio.Event()
        self.serving = False
        """True while somebody hears what is sent."""
        self._selection = selection
        self._every = selection.model_copy(update={"channels": ("*",)})
        self._most = most
        self._account = account
        self._cursor = cursor
        self._missed = missed
        self._picker: Picker | None = None
        self._models: dict[str, Picker] = {}

    def leave(self) -> None:
        """Nobody hears us: leave the rows to the record, if there is one."""
        self.serving = False
        if self._cursor is not None:
            for live in self.rows:
                self._leave(self._cursor, live)
            self.rows.clear()
        self.rows = deque(replace(live, late=True) for live in self.rows)
        self.results = deque(replace(told, late=True) for told in self.results)
        self._dropped("predictions", len(self.predictions))
        self.predictions.clear()

    def again(self, entry: Live | Told) -> None:
        """Take back what may not have arrived: a row is owed from the record, all else goes before others."""
        if isinstance(entry, Live) and self._cursor is not None:
            self._owe(self._cursor, entry)
            return
        queue: deque[Any] = self.rows if isinstance(entry, Live) else self.results
        if len(queue) < self._most:
            queue.appendleft(replace(entry, late=True))
        else:
            self._dropped("rows" if queue is self.rows else "results", 1)

    def succeed(self, before: Outbox) -> None:
        """Take over what waits in the outbox before this one."""
        self._account.expect(len(before.rows))
        self._account.owed += len(before.rows)
        self.results.extendleft(reversed(before.results))
        self.rows.extendleft(reversed(before.rows))
        self.last, self.begun = before.last, before.begun

    def frames(self, frames: Frames) -> None:
        """Make rows of frames."""
        picker = self._picker
        if picker is None or picker.layout != frames.layout:
            for row in () if picker is None else picker.rest():
                self._row(row, picker)
            picker = self._picker = Picker(self._selection, frames.layout)
            self.unmatched = picker.unmatched
            kinds = {c.name: c.kind for c in frames.layout.channels}
            self.labels = Labels(picker.units, {name: kinds[name] for name in picker.units})
            self.wake.set()
        for row in picker.rows(frames):
            self._row(row, picker)

    def _row(self, row: Row, picker: Picker | None) -> None:
        span = 0 if picker is None else picker.span
        if self.last is None:
            self.begun = self.last = row.time - span
        live = Live(row, self.last, not self.serving)
        self.last = row.time
        self._account.expect()
        self._account.owed += 1
        if live.late and self._cursor is not None:
            self._leave(self._cursor, live)
        else:
            self._put(self.rows, live, "rows")

    def prediction(self, item: Prediction) -> None:
        """Make rows of a model's output, if anybody hears them."""
        if not self.serving:
            self._dropped("predictions", 1)
            return
        frames = _as_frames(item, self._picker.layout.rate if self._picker else self._selection.rate)
        picker = self._models.get(item.model)
        if picker is None or picker.layout != frames.layout:
            picker = self._models[item.model] = Picker(self._every, frames.layout)
        for row in picker.rows(frames):
            self._put(self.predictions, Foreseen(item.model, picker.units, row), "predictions")

    def result(self, item: Result | Event) -> None:
        """Take a result or event."""
        self._put(self.results, Told(item, not self.serving), "results")

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

    def _leave(self, cursor: Cursor, live: Live) -> None:
        self._owe(cursor, live)
        self._account.count("rows left to the record")
        self._missed(live.row)

    def _owe(self, cursor: Cursor, live: Live) -> None:
        self._account.owed -= 1
        cursor.owe(live.before, live.row.time, 1)


def _as_frames(item: Prediction, rate: float) -> Frames:
    """A model's output as frames of its own."""
    channels = tuple(FrameChannel(name, item.units[name], "continuous", "hold") for name in item.outputs)
    values = np.array([item.outputs[c.name] for c in channels], np.float64).reshape(len(channels), len(item.time)).T
    quality = np.where(np.isfinite(values), Quality.GOOD, Quality.MISSING).astype(np.uint8)
    time = np.array(item.time, np.int64)
    return Frames(Layout(channels, rate), item.sequence, time, values, quality, np.zeros(values.shape, np.int64))
