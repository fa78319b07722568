"""Results and events in order of publication, for a successor of the `tell` process."""

from __future__ import annotations

from collections.abc import Iterator

from cellwatt.results import Alarm, Event, Result
from cellwatt.ring.items import ItemReader, ItemWriter, number_of
from cellwatt.ring.memory import Ring


class RingJournal:
    """Numbers published items by kind and keeps the last ones; alarms and events apart from the many other results."""

    def __init__(self, rare: Ring, frequent: Ring) -> None:
        self._rings = rare, frequent
        self._writers = ItemWriter(rare), ItemWriter(frequent)

    def put(self, item: Result | Event) -> int:
        """Add an item; return its number among those of its kind."""
        lane = 0 if isinstance(item, Alarm | Event) else 1
        number = self._rings[lane].following(number_of(type(item)))
        self._writers[lane].put(item)
        return number

    def past(self) -> Iterator[tuple[int, Result | Event]]:
        """Kept items with their numbers, each kind in order."""
        for ring in self._rings:
            reader = ItemReader(ring, 0)
            for item in reader.items():
                if isinstance(item, Result | Event):
                    yield reader.sequence, item
