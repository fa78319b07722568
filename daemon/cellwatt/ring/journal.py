"""Results and events in order of publication, and the alarm book, for a successor of the `tell` process."""

from __future__ import annotations

import json
from collections.abc import Iterator

from cellwatt.alarms import AlarmBook
from cellwatt.record import messages
from cellwatt.results import Alarm, Event, Result, series_of
from cellwatt.ring.items import STATUS, ItemReader, Status, kind_of
from cellwatt.ring.memory import Ring


class RingJournal:
    """Numbers items by series and stores the last ones: alarms and events in ``rare``, other results in ``frequent``.

    Each series is a channel of its ring, declared by its name; the series ``""`` has copies of the alarm book.
    """

    def __init__(self, rare: Ring, frequent: Ring) -> None:
        self._rings = rare, frequent
        self._channels = [{json.loads(line): n for n, line in enumerate(r.declared()[0])} for r in self._rings]
        self._last: tuple[Result | Event, int] | None = None
        self._book = AlarmBook()
        self._copied = 0
        """Bytes of ``rare`` when the book was last copied into it."""

    def restore(self, book: AlarmBook) -> None:
        """Bring ``book`` to the state that the stored items leave; ``put`` copies it before they are overwritten."""
        self._book = book
        for item in ItemReader(self._rings[0], 0).items():
            match item:
                case Status():
                    book.adopt([item.figures])
                case Alarm():
                    book.take(item)
                case Event():
                    book.note(item)

    def put(self, item: Result | Event) -> int:
        """Add an item; return its number in its series. Adding the last item again returns the same number.

        Raises ``ValueError`` if the item cannot be encoded as JSON or is too large.
        """
        if self._last is None or self._last[0] is not item:
            self._copy_book()
            lane = 0 if isinstance(item, Alarm | Event) else 1
            ring, channel = self._rings[lane], self._channel(lane, series_of(item))
            number = ring.following(channel)
            ring.put(kind_of(type(item)), channel, number, 1, messages.encode(item))
            self._last = item, number
        return self._last[1]

    def past(self) -> Iterator[tuple[int, Result | Event]]:
        """Stored items with their numbers, each series in order."""
        for ring in self._rings:
            reader = ItemReader(ring, 0)
            for item in reader.items():
                if isinstance(item, Result | Event):
                    yield reader.sequence, item

    def _copy_book(self) -> None:
        """Add each alarm of the book, once ``rare`` has taken half its size since the last copy."""
        ring = self._rings[0]
        if ring.head - self._copied < ring.size // 2:
            return
        channel = self._channel(0, "")
        for standing in self._book.state():
            if len(body := json.dumps(standing).encode()) <= ring.largest:
                ring.put(STATUS, channel, ring.following(channel), 1, body)
        self._copied = ring.head

    def _channel(self, lane: int, series: str) -> int:
        channels = self._channels[lane]
        if series not in channels:
            self._rings[lane].declare(json.dumps(series).encode())
            channels[series] = len(channels)
        return channels[series]
