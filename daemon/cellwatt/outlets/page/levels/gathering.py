"""The content of a recording that the page shows: curves, intervals, alarms and events about them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cellwatt.alarms import WORDS
from cellwatt.frames import Frames
from cellwatt.outlets.page.levels.buckets import STEPS, Buckets, coarser, joined, of_samples
from cellwatt.record.encoder import FRAME_TOPIC, Item
from cellwatt.record.messages import TOPICS
from cellwatt.results import Alarm, Event, Interval, Prediction

Columns = tuple[str, ...]
Samples = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Times (n,) UTC ns and values: (n,) of one channel, (n, channels) of several."""

CURVES: Final = frozenset([FRAME_TOPIC, TOPICS[Prediction]])
TELLING: Final = frozenset([TOPICS[Interval], TOPICS[Alarm], TOPICS[Event]])
"""Topics of a recording with the intervals and alarms that the page shows."""
FOLD: Final = 64
"""Number of blocks of samples that are collected before they are reduced to buckets."""


class Span(NamedTuple):
    """An interval; times UTC ns."""

    source: str
    number: int
    start: int
    end: int
    moving: tuple[int, ...]
    closed: bool

    @classmethod
    def of(cls, interval: Interval) -> Span:
        """The span of an interval."""
        return cls(*(getattr(interval, name) for name in cls._fields))

    def overlaps(self, start: int, end: int) -> bool:
        """True if the interval overlaps the time from ``start`` to before ``end``, UTC ns."""
        return self.end >= start and self.start < end


@dataclass(frozen=True, slots=True)
class Digest:
    """The content of a recording that the page shows, from ``start`` to ``end``, UTC ns.

    ``said``: alarm messages (only the last of successive updates) and events about alarms, in recorded order;
    ``finest``: buckets of the first of ``STEPS``, by their tuple of channels.
    """

    start: int
    end: int
    said: Sequence[Alarm | Event]
    spans: Sequence[Span]
    finest: Mapping[Columns, Buckets]

    def intervals(self) -> Sequence[Span]:
        """Intervals of the recording."""
        return self.spans

    def levels(self, level: int, wanted: Sequence[str]) -> Iterator[tuple[str, Buckets]]:
        """Buckets of ``STEPS[level]`` of each channel in ``wanted``, once per set of channels that contains it."""
        for columns, finest in self.finest.items():
            for name in set(wanted).intersection(columns):
                yield name, coarser(finest.channel(columns.index(name)), STEPS[level] // STEPS[0])


class Gathering:
    """Builds the digest of one recording from its items, in order."""

    def __init__(self) -> None:
        self._start, self._end = 2**62, 0
        self._waiting: dict[Columns, list[Samples]] = {}
        self._folded: dict[Columns, list[Buckets]] = {}
        self._spans: dict[tuple[str, int], Span] = {}
        self._said: list[Alarm | Event] = []
        self._up: dict[str, tuple[int, int | None]] = {}
        """``since`` of each active alarm, and the index in ``_said`` of its newest update."""

    def add(self, item: Item) -> None:
        """Add an item; items that the page does not show are ignored."""
        if (found := samples_of(item)) is not None and len(found[1]):
            columns, time, values = found
            waiting = self._waiting.setdefault(columns, [])
            waiting.append((time, values))
            if len(waiting) == FOLD:
                self._fold(columns)
            self._reach(int(time.min()), int(time.max()))
        elif isinstance(item, Interval):
            self._spans[item.source, item.number] = Span.of(item)
            self._reach(item.start, item.end)
        elif isinstance(item, Alarm):
            self._alarm(item)
        elif isinstance(item, Event) and item.kind in (*WORDS, "evidence"):
            self._said.append(item)

    def digest(self) -> Digest:
        """Digest of all items so far."""
        for columns in list(self._waiting):
            self._fold(columns)
        finest = {columns: joined(parts) for columns, parts in self._folded.items()}
        self._folded = {columns: [whole] for columns, whole in finest.items()}
        spans = sorted(self._spans.values(), key=attrgetter("start"))
        return Digest(self._start, self._end, tuple(self._said), spans, finest)

    def _fold(self, columns: Columns) -> None:
        time, values = (np.concatenate(arrays) for arrays in zip(*self._waiting.pop(columns), strict=True))
        self._folded.setdefault(columns, []).append(of_samples(time, values, STEPS[0]).single())

    def _reach(self, first: int, last: int) -> None:
        self._start, self._end = min(self._start, first), max(self._end, last)

    def _alarm(self, alarm: Alarm) -> None:
        """Store the raise of an alarm, its newest update and its clear."""
        since, index = self._up.get(alarm.id, (None, None))
        if alarm.active and since == alarm.since and index is not None:
            self._said[index] = alarm
            return
        if alarm.active:
            self._up[alarm.id] = (alarm.since, len(self._said) if since == alarm.since else None)
        else:
            self._up.pop(alarm.id, None)
        self._said.append(alarm)


def samples_of(item: Item) -> tuple[Columns, NDArray[np.int64], NDArray[np.float64]] | None:
    """Names, times (n,), UTC ns, and values (n, names) of frames, or of a prediction, cut to its shortest output.

    Outputs are named ``prediction/<model>/<output>``. ``None`` for any other item.
    """
    if isinstance(item, Frames):
        return item.layout.names, item.time, item.values
    if not isinstance(item, Prediction):
        return None
    n = min([len(item.time), *map(len, item.outputs.values())])
    values = np.array([v[:n] for v in item.outputs.values()], np.float64).reshape(len(item.outputs), n)
    names = tuple(f"prediction/{item.model}/{output}" for output in item.outputs)
    return names, np.array(item.time[:n], np.int64), values.T
