"""The part of a recording that the page shows: buckets of frames and predictions, intervals, alarms, their events."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt import alarms
from cellwatt.frames import Frames
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, joined, of_samples
from cellwatt.record.encoder import FRAME_TOPIC, Item
from cellwatt.record.messages import TOPICS
from cellwatt.results import Alarm, Event, Interval, Prediction

Columns = tuple[str, ...]

CURVES: Final = frozenset([FRAME_TOPIC, TOPICS[Prediction]])
TELLING: Final = frozenset([TOPICS[Interval], TOPICS[Alarm], TOPICS[Event]])
"""Topics of a recording that hold what the page shows beside the curves."""
WORDS: Final = frozenset([*alarms.WORDS, "evidence"])
"""Kinds of events about alarms: the word of people, and where the evidence is kept."""
FOLD: Final = 4096
"""Samples that wait until they become buckets."""

SPANS: Final = np.dtype([("start", "<i8"), ("end", "<i8"), ("number", "<i8"), ("what", "<u4")])
Spans = NDArray[np.void]


@dataclass(frozen=True, slots=True)
class Intervals:
    """Intervals of a recording in order: ``spans`` (n,) with start and end in UTC ns, number, and place in ``whats``:
    source, moving joints, closed.
    """

    spans: Spans
    whats: tuple[tuple[str, tuple[int, ...], bool], ...]

    @classmethod
    def of(cls, intervals: Iterable[Interval]) -> Intervals:
        """The arrays of some intervals."""
        whats: dict[tuple[str, tuple[int, ...], bool], int] = {}
        rows = [
            (i.start, i.end, i.number, whats.setdefault((i.source, i.moving, i.closed), len(whats))) for i in intervals
        ]
        return cls(np.array(sorted(rows), SPANS), tuple(whats))

    def within(self, start: int, end: int) -> tuple[Spans, Sequence[tuple[str, tuple[int, ...], bool]]]:
        """Those that have any of the time from ``start`` to ``end`` UTC ns, and the table of what they are."""
        return self.spans[(self.spans["end"] >= start) & (self.spans["start"] < end)], self.whats


@dataclass(frozen=True, slots=True)
class Said:
    """Messages of alarms and events about them, in recorded order; of the updates of an alarm only the last."""

    alarms: tuple[Alarm, ...] = ()
    words: tuple[Event, ...] = ()


class Gathering:
    """Takes the items of one recording in order."""

    def __init__(self) -> None:
        self.start, self.end = 2**62, 0
        """UTC ns of the earliest and the latest sample or interval."""
        self._columns: dict[Columns, _Pile] = {}
        self._intervals: dict[tuple[str, int], Interval] = {}
        self._alarms: list[Alarm] = []
        self._up: dict[str, tuple[int, int | None]] = {}
        """``since`` of each alarm that is up, and the place of its newest update."""
        self._words: list[Event] = []

    def add(self, item: Item) -> None:
        """Take an item; those that the page does not show are passed over."""
        match item:
            case Frames():
                self._pile(item.layout.names).add(item.time, item.values)
                self._reach(int(item.time.min()), int(item.time.max()))
            case Prediction():
                time, values = prediction_arrays(item)
                if len(time):
                    self._pile(prediction_names(item)).add(time, values)
                    self._reach(int(time.min()), int(time.max()))
            case Interval():
                self._intervals[item.source, item.number] = item
                self._reach(item.start, item.end)
            case Alarm():
                self._alarm(item)
            case Event() if item.kind in WORDS:
                self._words.append(item)

    @property
    def said(self) -> Said:
        """Alarms and events so far."""
        return Said(tuple(self._alarms), tuple(self._words))

    @property
    def intervals(self) -> Intervals:
        """Intervals so far."""
        return Intervals.of(self._intervals.values())

    def finest(self) -> Mapping[Columns, Buckets]:
        """Buckets of the first of ``STEPS`` by the channels that they have."""
        return {columns: pile.buckets() for columns, pile in self._columns.items()}

    def _pile(self, columns: Columns) -> _Pile:
        return self._columns.setdefault(columns, _Pile(len(columns)))

    def _reach(self, first: int, last: int) -> None:
        self.start, self.end = min(self.start, first), max(self.end, last)

    def _alarm(self, alarm: Alarm) -> None:
        """Keep the raise of an alarm, its newest update and its clear."""
        since, place = self._up.get(alarm.id, (None, None))
        if alarm.active and since == alarm.since and place is not None:
            self._alarms[place] = alarm
            return
        if alarm.active:
            self._up[alarm.id] = (alarm.since, len(self._alarms) if since == alarm.since else None)
        else:
            self._up.pop(alarm.id, None)
        self._alarms.append(alarm)


class _Pile:
    """Samples of some channels that become buckets many at a time."""

    def __init__(self, channels: int) -> None:
        self._channels = channels
        self._waiting: list[tuple[NDArray[np.int64], NDArray[np.float64]]] = []
        self._count = 0
        self._parts: list[Buckets] = []

    def add(self, time: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        self._waiting.append((time, values))
        self._count += len(time)
        if self._count >= FOLD:
            self._fold()

    def buckets(self) -> Buckets:
        self._fold()
        whole = joined(self._parts, self._channels)
        self._parts = [whole]
        return whole

    def _fold(self) -> None:
        if self._count:
            time, values = (np.concatenate(arrays) for arrays in zip(*self._waiting, strict=True))
            self._parts.append(of_samples(time, values, STEPS[0]))
        self._waiting, self._count = [], 0


def prediction_names(prediction: Prediction) -> Columns:
    """Names under which the outputs of a model are asked for."""
    return tuple(f"prediction/{prediction.model}/{output}" for output in prediction.outputs)


def prediction_arrays(prediction: Prediction) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Times (n,) UTC ns and values (n, outputs) of a prediction, as many as all outputs have."""
    n = min([len(prediction.time), *(len(values) for values in prediction.outputs.values())])
    values = np.array([v[:n] for v in prediction.outputs.values()], np.float64).reshape(len(prediction.outputs), n)
    return np.array(prediction.time[:n], np.int64), values.T
