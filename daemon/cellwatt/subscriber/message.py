"""A message as a subscriber hands it out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.order import Gap
from cellwatt.outlets.zenoh.received import Health
from cellwatt.results import Event, Result

EVERYTHING: Final = ("raw", "frame", "interval", "task", "energy", "prediction", "alarm", "event", "health")
"""All topics of a cell."""


@dataclass(frozen=True, slots=True)
class Message:
    """A message of the cell with its place in the order.

    ``sequence`` is the number of the first sample (raw, frame) or of the result within ``topic`` and ``session``.
    ``backfilled`` if it was asked for later, because it was missed or happened before the subscription began.
    """

    topic: str
    session: int
    sequence: int
    backfilled: bool
    content: Batch | Frames | Result | Event | Health | Gap

    @property
    def count(self) -> int:
        """Number of samples in it; 1 for a result."""
        content = self.content
        if isinstance(content, Gap):
            return content.count
        return len(content) if isinstance(content, Batch | Frames) else 1
