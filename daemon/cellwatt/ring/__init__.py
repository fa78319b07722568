"""The way between the daemon's processes: a ring in shared memory that its writer never waits for."""

from cellwatt.ring.items import ItemReader, ItemWriter, Mark, Skipped, Status
from cellwatt.ring.journal import RingJournal
from cellwatt.ring.memory import Ring

__all__ = ["ItemReader", "ItemWriter", "Mark", "Ring", "RingJournal", "Skipped", "Status"]
