"""Puts the messages of one topic in order, each exactly once, and finds the missing ones. Pure."""

from __future__ import annotations

from bisect import insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from cellwatt.batch import Batch
from cellwatt.blocks import cut
from cellwatt.frames import Frames
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
