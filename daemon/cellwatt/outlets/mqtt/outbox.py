"""What waits for the broker and is owed to nobody: events, intervals and predictions."""

from __future__ import annotations

import asyncio
from collections import defaultdict, deque
from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from cellwatt.account import Account
from cellwatt.channel import Quality
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.results import Event, Interval, Prediction

T = TypeVar("T")


class Outbox:
    """Queues of ``most`` entries each; a full queue drops its oldest entry and counts it.

    ``wake`` is set when there is something to send.
    """

    def __init__(self, selection: Selection, most: int, account: Account) -> None:
        self.results: deque[tuple[Interval | Event, bool]] = deque()
        """Events and intervals; true if made without a connection."""
        self.predictions: deque[tuple[str, Mapping[str, str], Row]] = deque()
        """(name of the model, units of its outputs, row of its outputs)."""
        self.labelled: Mapping[str, str] | None = None
        """The units of the rows' channels that were last published."""
        self.wake = asyncio.Event()
        self._most, self._account = most, account
        every = selection.model_copy(update={"channels": ("*",)})
        self._models: defaultdict[str, Picker] = defaultdict(lambda: Picker(every))

    def prediction(self, item: Prediction, rate: float) -> None:
        """Queue the rows of a model's output for frames of ``rate``, Hz."""
        picker = self._models[item.model]
        for row in picker.rows(_as_frames(item, rate)):
            self._put(self.predictions, (item.model, picker.units, row), "predictions")

    def result(self, item: Interval | Event, late: bool) -> None:
        """Queue an event or interval."""
        self._put(self.results, (item, late), "results")

    def _put(self, queue: deque[T], entry: T, what: str) -> None:
        if len(queue) >= self._most:
            queue.popleft()
            self._account.count(f"{what} dropped")
        queue.append(entry)
        self.wake.set()


def _as_frames(item: Prediction, rate: float) -> Frames:
    """A model's output as frames."""
    channels = tuple(FrameChannel(name, item.units[name], "continuous", "hold") for name in item.outputs)
    values = np.array([item.outputs[c.name] for c in channels], np.float64).reshape(len(channels), len(item.time)).T
    quality = np.where(np.isfinite(values), Quality.GOOD, Quality.MISSING).astype(np.uint8)
    time = np.array(item.time, np.int64)
    return Frames(Layout(channels, rate), item.sequence, time, values, quality, np.zeros(values.shape, np.int64))
