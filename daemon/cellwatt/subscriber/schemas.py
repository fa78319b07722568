"""The Arrow schemas that most messages of samples leave out, and the messages that wait for theirs. Pure."""

from __future__ import annotations

import zlib
from typing import TYPE_CHECKING, Final

from cellwatt.outlets.zenoh.order import HELD_BYTES

if TYPE_CHECKING:
    import zenoh

_MOST: Final = 1000
"""Messages that wait, and topics; a cell has some ten streams and sends each schema once a second."""


class Schemas:
    """The last schema of each topic, and the messages that need another one, which is on its way."""

    def __init__(self) -> None:
        self._known: dict[str, dict[int, bytes]] = {}
        self._waiting: dict[str, list[zenoh.Sample]] = {}
        self._held, self._size = 0, 0

    def of(self, topic: str) -> dict[int, bytes]:
        """The schema of a topic by its CRC-32; empty if none came yet."""
        return self._known.get(topic, {})

    def hold(self, topic: str, sample: zenoh.Sample) -> bool:
        """Keep a message until the next schema of its topic comes; return False if there is no room."""
        if self._held >= _MOST or self._size + len(sample.payload) > HELD_BYTES:
            return False
        self._waiting.setdefault(topic, []).append(sample)
        self._held += 1
        self._size += len(sample.payload)
        return True

    def learn(self, topic: str, schema: bytes) -> list[zenoh.Sample]:
        """Take a topic's schema; return the messages that waited for it, oldest first."""
        if topic in self._known or len(self._known) < _MOST:
            self._known[topic] = {zlib.crc32(schema): schema}
        waited = self._waiting.pop(topic, [])
        self._held -= len(waited)
        self._size -= sum(len(sample.payload) for sample in waited)
        return waited
