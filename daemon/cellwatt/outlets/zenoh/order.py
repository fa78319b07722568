"""Puts the messages of one topic in order, each exactly once, and finds the missing ones. Pure.

Anyone who can publish on a cell's keys can claim a new session, a jump of its numbers, or samples that were never
measured. If such a message were followed at once, every true message after it would look old and the stream would
end. So a message that does not continue the known numbering waits in ``Doubts`` until the cell has been asked.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames, cut
from cellwatt.results import Event, Result

HELD_BYTES: Final = 128 * 1024 * 1024
"""Most bytes of parts that are held back, whatever their number."""
_PAST: Final = 16
"""Finished sessions remembered, to know a straggler from a new session."""
_NO_END: Final = 2**63


@dataclass(frozen=True, slots=True)
class Gap:
    """``count`` samples or messages that are lost for good, with the ``reason``."""

    count: int
    reason: str


@dataclass(frozen=True, slots=True)
class Part:
    """Samples ``sequence`` … ``end`` of a topic in a session, or one result; its message had ``size`` bytes."""

    session: int
    sequence: int
    count: int
    backfilled: bool
    content: Batch | Frames | Result | Event | Gap
    size: int = 0

    @property
    def end(self) -> int:
        """Number of the sample after the last."""
        return self.sequence + self.count

    def after(self, first: int) -> Part:
        """The rest of the part from number ``first`` on."""
        if first <= self.sequence:
            return self
        content = self.content
        if isinstance(content, Batch | Frames):
            content = cut(content, first - self.sequence, self.count)
        return replace(self, sequence=first, count=self.end - first, content=content)


@dataclass(frozen=True, slots=True)
class Hole:
    """Numbers ``first`` … ``first + count`` are missing; to the end of the session where ``count`` is ``None``.

    ``certain`` if later ones are here; otherwise they were announced and may still be on their way.
    """

    session: int
    first: int
    count: int | None
    certain: bool


class Follower:
    """Follows one topic from number ``following`` of ``session`` on.

    Parts that arrive early are held back, at most ``hold`` of them; further ones are discarded and asked for
    again. ``duplicates`` counts the samples that arrived more than once.
    """

    def __init__(self, session: int, following: int, hold: int = 1000) -> None:
        self.session = session
        self.following = following
        self.duplicates = 0
        self._hold = hold
        self._held: dict[int, list[Part]] = {}
        self._ends: dict[int, int] = {}
        self._later: list[int] = []
        self._past: deque[int] = deque(maxlen=_PAST)

    def take(self, part: Part) -> list[Part]:
        """Take a part in order of arrival; return the parts that are in order now."""
        if part.sequence == self.following and part.session == self.session and not self._held:
            self.following = part.end
            return [part]
        if part.session in self._past or (part.session == self.session and part.end <= self.following):
            self.duplicates += part.count
            return []
        self.announce(part.session, part.end)
        held = self._held.setdefault(part.session, [])
        if part.session == self.session and part.sequence <= self.following:
            held.insert(0, part)
        elif self._room(part.size):
            insort(held, part, key=lambda p: p.sequence)
        return self._ready()

    def reach(self, session: int) -> int | None:
        """The number up to which messages of ``session`` are known to exist; ``None`` for an unknown session.

        A finished session has no such number: everything that arrives of it is a duplicate.
        """
        if session in self._past:
            return _NO_END
        if session == self.session:
            return max(self.following, self._ends.get(session, 0))
        return self._ends.get(session, 0) if session in self._later else None

    def announce(self, session: int, end: int) -> None:
        """Note that numbers below ``end`` exist in ``session``."""
        if session in self._past:
            return
        if session != self.session and session not in self._later:
            self._later.append(session)
        self._ends[session] = max(end, self._ends.get(session, 0))

    def _room(self, size: int) -> bool:
        parts = [part for held in self._held.values() for part in held]
        return len(parts) < self._hold and sum(part.size for part in parts) + size <= HELD_BYTES

    @property
    def newest(self) -> int:
        """The last session known."""
        return self._later[-1] if self._later else self.session

    def between(self, sessions: Sequence[int]) -> None:
        """Insert sessions, oldest first, among the known ones."""
        following = self.newest
        for session in reversed(sessions):
            if session not in self._later and session != self.session and session not in self._past:
                self._later.insert(self._later.index(following), session)
            if session in self._later:
                following = session

    @property
    def over(self) -> bool:
        """True if a later session has begun."""
        return bool(self._later)

    def hole(self) -> Hole | None:
        """The first hole, or ``None``."""
        held = self._held.get(self.session)
        if held:
            return Hole(self.session, self.following, held[0].sequence - self.following, certain=True)
        end = self._ends.get(self.session, 0)
        if end > self.following:
            return Hole(self.session, self.following, end - self.following, certain=self.over)
        if self.over:
            return Hole(self.session, self.following, None, certain=True)
        return None

    def fill(self, part: Part) -> list[Part]:
        """Take an answer to ``hole``. If it begins later than asked, the messages before it are lost."""
        lost: list[Part] = []
        if part.session == self.session and part.sequence > self.following:
            lost = self._lost(part.sequence, "no longer in the record of the cell")
        return lost + self.take(part)

    def give_up(self, hole: Hole, reason: str) -> list[Part]:
        """Give up ``hole``, which the cell no longer has; return the gap and the parts after it."""
        if (hole.session, hole.first) != (self.session, self.following):
            return []
        if hole.count is None:
            return self._next_session()
        return self._lost(hole.first + hole.count, reason)

    def _lost(self, end: int, reason: str) -> list[Part]:
        count = end - self.following
        gap = Part(self.session, self.following, count, True, Gap(count, reason))
        self.following = end
        return [gap, *self._ready()]

    def _ready(self) -> list[Part]:
        held = self._held.get(self.session, [])
        ready: list[Part] = []
        while held and held[0].sequence <= self.following:
            part = held.pop(0)
            fresh = part.end - self.following
            self.duplicates += part.count - max(fresh, 0)
            if fresh > 0:
                ready.append(part.after(self.following))
                self.following = part.end
        if not held:
            self._held.pop(self.session, None)
        return ready

    def _next_session(self) -> list[Part]:
        self._past.append(self.session)
        self._held.pop(self.session, None)
        self._ends.pop(self.session, None)
        self.session = self._later.pop(0)
        self.following = 0
        return self._ready()


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
