"""Results and events in order of publication, for a successor of the `tell` process."""

from __future__ import annotations

import json
from collections.abc import Iterator

from cellwatt.record import messages
from cellwatt.results import Alarm, Event, Result, series_of
from cellwatt.ring.items import ItemReader, kind_of
from cellwatt.ring.memory import Ring


class RingJournal:
    """Numbers items by series and stores the last ones: alarms and events in ``rare``, other results in ``frequent``.

    Each series is a channel of its ring, declared by its name.
    """

    def __init__(self, rare: Ring, frequent: Ring) -> None:
        self._rings = rare, frequent
        self._channels = [{json.loads(line): n for n, line in enumerate(r.declared()[0])} for r in self._rings]
        self._last: tuple[Result | Event, int] | None = None

    def put(self, item: Result | Event) -> int:
        """Add an item; return its number in its series. Adding the last item again returns the same number.

        Raises ``ValueError`` if the item cannot be encoded as JSON or is too large.
        """
        if self._last is None or self._last[0] is not item:
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

    def _channel(self, lane: int, series: str) -> int:
        channels = self._channels[lane]
        if series not in channels:
            self._rings[lane].declare(json.dumps(series).encode())
            channels[series] = len(channels)
        return channels[series]
