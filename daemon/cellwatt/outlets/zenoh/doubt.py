"""Messages that wait until the cell confirms them. Pure.

Anyone who can publish on a cell's keys can claim a new session, a jump of its numbers, or samples that were never
measured. If such a message were followed at once, every true message after it would look old and the stream would
end. So a message that does not continue the known numbering waits here until the cell has been asked.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from cellwatt.outlets.zenoh.order import HELD_BYTES, Part

_MOST: Final = 1000
"""Parts that wait for the cell's word; those beyond are let go and, where they were true, asked for again."""
_GRACE: Final = 0.2
"""Time, s, that what a health message tells may still be on its way."""
_PAUSE: Final = 0.1
"""Pause, s, between two questions; doubled, up to ``_LONGEST``, while they come to nothing."""
_LONGEST: Final = 2.0


@dataclass(slots=True)
class Doubts:
    """Unconfirmed parts by topic, and the positions (session, next number) that live health messages claimed."""

    parts: dict[str, list[Part]] = field(default_factory=dict)
    claims: dict[str, tuple[int, int]] = field(default_factory=dict)
    _waiting: int = 0
    _size: int = 0
    _asked: tuple[dict[str, int], dict[str, tuple[int, int]]] = field(default_factory=lambda: ({}, {}))
    _claimed_at: float | None = None
    _due: float = -math.inf
    _pause: float = _PAUSE

    def add(self, topic: str, part: Part) -> bool:
        """Keep a part until the cell has answered; return False if there is no room."""
        if self._waiting >= _MOST or self._size + part.size > HELD_BYTES:
            return False
        self.parts.setdefault(topic, []).append(part)
        self._waiting += 1
        self._size += part.size
        return True

    def asks(self, now: float, anyhow: bool) -> bool:
        """True if the cell should be asked now, also without parts if ``anyhow``."""
        if now < self._due:
            return False
        if not self.claims:
            self._claimed_at = None
        elif self._claimed_at is None:
            self._claimed_at = now
        claimed = self._claimed_at is not None and now - self._claimed_at >= _GRACE
        if not (anyhow or self.parts or claimed):
            return False
        self._due = math.inf
        self._asked = {topic: len(parts) for topic, parts in self.parts.items()}, dict(self.claims)
        return True

    def answered(self) -> tuple[Mapping[str, list[Part]], Mapping[str, tuple[int, int]]]:
        """Remove and return the parts and claims that were waiting when the cell was asked."""
        counts, claims = self._asked
        parts = {topic: self._taken(topic, count) for topic, count in counts.items()}
        self.claims = {topic: claim for topic, claim in self.claims.items() if claims.get(topic) != claim}
        self._claimed_at, self._asked = None, ({}, {})
        return parts, claims

    def drain(self) -> Mapping[str, list[Part]]:
        """Remove and return all parts."""
        return {topic: self._taken(topic, len(parts)) for topic, parts in list(self.parts.items())}

    def judged(self, now: float, refused: bool) -> None:
        """Note the verdict on the parts; after a refusal the cell is asked less often."""
        self._pause = min(2 * self._pause, _LONGEST) if refused else _PAUSE
        self._due = now + self._pause

    def unanswered(self, now: float) -> None:
        """Note that no answer came; the parts go on waiting."""
        self._pause = min(2 * self._pause, _LONGEST)
        self._due = now + self._pause

    def _taken(self, topic: str, count: int) -> list[Part]:
        parts = self.parts[topic]
        taken, rest = parts[:count], parts[count:]
        if rest:
            self.parts[topic] = rest
        else:
            del self.parts[topic]
        self._waiting -= len(taken)
        self._size -= sum(part.size for part in taken)
        return taken
