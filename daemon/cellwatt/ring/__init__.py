"""Rings in shared memory between the daemon's processes; the writer of a ring never waits."""

from cellwatt.ring.items import ItemReader, ItemWriter, Mark, Status
from cellwatt.ring.journal import RingJournal
from cellwatt.ring.memory import Ring

__all__ = ["ItemReader", "ItemWriter", "Mark", "Ring", "RingJournal", "Status"]
