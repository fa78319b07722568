"""Answers about the past: from memory and the record, one bounded piece at a time, in turn, at a limited rate.

A consumer may have missed days of samples, which are sent over the same line as the live data. A limit leaves room
for the live data; pieces are small enough that no waiting consumer times out before the next piece.
"""

from __future__ import annotations

import math
import queue
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames, cut, join
from cellwatt.outlet import CellView
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.encode import ARROW, JSON, encode
from cellwatt.outlets.zenoh.keys import ALARM, FRAME, raw_topic, series_of_topic
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item
from cellwatt.outlets.zenoh.questions import NothingKeptError, number_of, short, text_of
from cellwatt.record.messages import time_of
from cellwatt.results import Event, Result

MOST_SAMPLES: Final = 2000
"""Most samples in one answer; about 1 MB for sixty channels."""
MOST_RESULTS: Final = 500
"""Most results, or cleared alarms, in one answer."""
_EVER: Final = 2**62
"""Count of a question without one: everything."""
_ROW: Final = 33
"""Approximate bytes of one sample or frame beside its channels."""
_CELL: Final = 17
"""Bytes of one channel in a frame: value, quality and bound."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One answer; ``path`` is its topic, if it is a back-filled message."""

    payload: bytes
    encoding: str = JSON
    mark: Mark | None = None
    path: str | None = None


class Past:
    """The past data that a cell still has; ``piece`` returns the largest size of an answer now, bytes."""

    def __init__(self, view: CellView, backlog: Backlog, piece: Callable[[], float]) -> None:
        self._view, self._backlog, self._piece = view, backlog, piece

    def history(self, asked: Mapping[str, str]) -> Answer:
        """Recorded samples, or frames. Raises ``QuestionError``, or ``NothingKeptError`` if none are stored."""
        session, first = number_of(asked, "session", self._view.session), number_of(asked, "first", 0)
        whole = number_of(asked, "count", _EVER)
        count = min(whole, MOST_SAMPLES)
        blocks: Sequence[Batch | Frames]
        if "source" not in asked and asked.get("stream") == FRAME:
            topic, nothing = FRAME, "no frames are stored"
            blocks = self._view.frame_history(session, first, count)
        else:
            source, stream = text_of(asked, "source"), text_of(asked, "stream")
            topic, nothing = raw_topic(source, stream), f"nothing is recorded of {f'{source}/{stream}':.120}"
            blocks = self._view.history(source, stream, session, first, count)
        block = join(blocks, count)
        if block is not None:  # it may begin after the requested span, if that is no longer stored
            most = max(int(min(len(block), self._piece() / _size(block))), 1)
            block = cut(block, 0, max(min(most, first + whole - block.sequence), 0))
        if not block:
            raise NothingKeptError(f"{nothing} from {first} in session {session}")
        arrival = block.arrival if isinstance(block, Batch) else int(block.time[-1])
        return Answer(encode(block), ARROW, Mark(session, block.sequence, len(block), arrival, backfill=True), topic)

    def results(self, asked: Mapping[str, str]) -> Answer:
        """Results or events of one kind. Raises ``QuestionError``, or ``NothingKeptError`` if none are stored."""
        kind, session = text_of(asked, "kind"), number_of(asked, "session", self._backlog.session)
        kept = self._results(kind, session, number_of(asked, "first", 0), number_of(asked, "count", _EVER))
        if not kept:
            raise NothingKeptError(f"no results {short(kind)} are stored from there in session {session}")
        items, room = [], self._piece()
        for m, item in kept:
            items.append(encode_item(item, m))
            room -= len(items[-1])
            if room <= 0:
                break
        first, last = kept[0][0], kept[len(items) - 1][0]
        mark = Mark(session, first.sequence, last.end - first.sequence, last.arrival, backfill=True)
        return Answer(b"[" + b",".join(items) + b"]", JSON, mark, kind)

    def _results(self, kind: str, session: int, first: int, whole: int) -> Sequence[tuple[Mark, Result | Event]]:
        """Results from memory; from the record if memory begins later."""
        kept = self._backlog.results(kind, session, first, whole)[:MOST_RESULTS]
        begin = kept[0][0].sequence if kept else first + whole
        if begin <= first or kind == ALARM:
            return kept
        asked = series_of_topic(kind), session, first, min(begin - first, MOST_RESULTS)
        recorded = [(number, item) for number, item in self._view.result_history(*asked) if number < begin]
        return [(Mark(session, number, 1, time_of(item)), item) for number, item in recorded] or kept


def _size(block: Batch | Frames) -> int:
    """Approximate bytes of one row in an answer."""
    return _ROW + (8 * len(block.stream.channels) if isinstance(block, Batch) else _CELL * len(block.layout.channels))


Work = Callable[[], None]

_PIECE: Final = 0.25
"""Longest time, s, that one answer about the past may take at the rate limit."""
_ROUND: Final = 2.0
"""Longest time, s, for one piece of each waiting question together: a consumer waits 5 s for an answer."""


class Turns:
    """Questions that wait for the answering thread, at most ``limit``, those about the present first.

    Answers about the past take ``rate`` bytes per second on average, one piece at a time; ``None``: no limit.
    ``held_back`` is called for each question delayed by this.
    """

    def __init__(self, rate: float | None, limit: int, held_back: Callable[[], None]) -> None:
        self._rate, self._limit, self._held_back = rate, limit, held_back
        self._free_at = 0.0
        self._arrived: queue.SimpleQueue[tuple[Work, bool] | None] = queue.SimpleQueue()
        self._past: deque[Work] = deque()

    def delay(self, now: float) -> float:
        """Time, s, until the next piece of the past may be sent."""
        return max(self._free_at - now, 0.0)

    def spend(self, size: int, now: float) -> None:
        """Note that a piece of ``size`` bytes is sent now."""
        if self._rate is not None:
            self._free_at = max(self._free_at, now) + size / self._rate

    def piece(self) -> float:
        """Most bytes of one answer, given the number of waiting questions; infinite without a limit."""
        return math.inf if self._rate is None else self._rate * min(_PIECE, _ROUND / (1 + len(self._past)))

    def put(self, work: Work, past: bool) -> bool:
        """Queue the work of answering a question; return False if the queue is full. Never blocks."""
        if self._arrived.qsize() + len(self._past) >= self._limit:
            return False
        self._arrived.put((work, past))
        return True

    def end(self) -> None:
        """Make ``take`` return ``None``."""
        self._arrived.put(None)

    def take(self) -> Work | None:
        """Wait for the next question to answer; ``None`` after ``end``. For one thread."""
        while True:
            try:
                arrived = self._arrived.get(timeout=self.delay(time.monotonic()) if self._past else None)
            except queue.Empty:
                return self._past.popleft()
            if arrived is None:
                return None
            work, past = arrived
            if not past:
                return work
            if self._past or self.delay(time.monotonic()) > 0:
                self._held_back()
            self._past.append(work)
