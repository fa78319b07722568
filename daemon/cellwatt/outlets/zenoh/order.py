"""Puts the messages of one topic in order, each exactly once, and finds the missing ones. Pure.

A session is known once it was ``announce``d; messages of an unknown session are held until then.
"""

from __future__ import annotations

import math
from bisect import insort
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames, cut
from cellwatt.outlets.zenoh.received import Health
from cellwatt.results import Event, Result

HELD_BYTES: Final = 128 * 1024 * 1024
"""Most bytes of held messages, whatever their number."""
_PAST: Final = 16
"""Number of finished sessions remembered, to distinguish a late message from a new session."""


@dataclass(frozen=True, slots=True)
class Gap:
    """``count`` samples or messages that are lost, with the ``reason``."""

    count: int
    reason: str


@dataclass(frozen=True, slots=True)
class Message:
    """A message of the cell with its position.

    ``sequence`` is the number of the first sample (raw, frame) or of the result within ``topic`` and ``session``.
    ``backfilled``: it was requested later, because it was missed or is older than the subscription. ``size``: bytes of
    a live message as received.
    """

    topic: str
    session: int
    sequence: int
    backfilled: bool
    content: Batch | Frames | Result | Event | Health | Gap
    size: int = field(default=0, repr=False, compare=False)

    @property
    def count(self) -> int:
        """Number of samples in it; 1 for a result."""
        content = self.content
        if isinstance(content, Gap):
            return content.count
        return len(content) if isinstance(content, Batch | Frames) else 1

    @property
    def end(self) -> int:
        """Number of the sample after the last one."""
        return self.sequence + self.count

    def after(self, first: int) -> Message:
        """The remainder of the message from number ``first`` on."""
        if first <= self.sequence or not isinstance(self.content, Batch | Frames):
            return self
        return replace(self, sequence=first, content=cut(self.content, first - self.sequence, self.count))


@dataclass(frozen=True, slots=True)
class Hole:
    """Numbers ``first`` … ``first + count`` are missing; to the end of the session if ``count`` is ``None``.

    ``certain``: later numbers have arrived; otherwise the missing ones were announced and may still be in transit.
    """

    session: int
    first: int
    count: int | None
    certain: bool


class Follower:
    """Follows one ``topic`` from number ``following`` of ``session`` on.

    At most ``hold`` messages that arrive early are held; further ones are discarded and requested again.
    ``duplicates`` counts the samples that arrived more than once.
    """

    def __init__(self, topic: str, session: int, following: int, hold: int = 1000) -> None:
        self.topic = topic
        self.begun = session, following
        self.session, self.following = session, following
        self.duplicates = 0
        self.asking = False
        """True while a question about the first hole awaits its answer."""
        self.asked_about: tuple[int, int, bool] | None = None
        """The hole to which ``due``, the time of the next question, belongs: session, first number, certain."""
        self.due = -math.inf
        self.empty_since: float | None = None
        """Time since which the cell has answered that it has none of the messages, or ``None``."""
        self.entered: int | None = None
        """The newest session before which all recorded sessions are known."""
        self._hold = hold
        self._held: dict[int, list[Message]] = {}
        """Messages that arrived early, by session, in order."""
        self._ends = {session: 0}
        """Number below which messages are known to exist, by session."""
        self._later: list[int] = []
        self._past: deque[int] = deque(maxlen=_PAST)

    def take(self, part: Message) -> list[Message]:
        """Add a message that arrived; return those that are now in order."""
        current = part.session == self.session
        if part.sequence == self.following and current and not self._held:
            self.following = part.end
            return [part]
        if part.session in self._past or (current and part.end <= self.following):
            self.duplicates += part.count
            return []
        if (current and part.sequence <= self.following) or self._room(part.size):
            insort(self._held.setdefault(part.session, []), part, key=lambda p: p.sequence)
        if self.knows(part.session):
            self.announce(part.session, part.end)
        return self._ready()

    def knows(self, session: int) -> bool:
        """True for the current session, those announced, and those finished."""
        return session in self._ends or session in self._past

    def announce(self, session: int, end: int) -> None:
        """Note that numbers below ``end`` exist in ``session``, and so do its held messages."""
        if session in self._past:
            return
        if session not in self._ends:
            self._later.append(session)
            end = max([end, *(part.end for part in self._held.get(session, ()))])
        self._ends[session] = max(end, self._ends.get(session, 0))

    def release_unknown(self) -> None:
        """Discard held messages of unknown sessions: they are requested once their session is known."""
        self._held = {session: held for session, held in self._held.items() if session in self._ends}

    def _room(self, size: int) -> bool:
        sizes = [part.size for held in self._held.values() for part in held]
        return len(sizes) < self._hold and sum(sizes) + size <= HELD_BYTES

    @property
    def newest(self) -> int:
        """The newest known session."""
        return self._later[-1] if self._later else self.session

    def between(self, recorded: Iterable[int]) -> None:
        """Insert the recorded sessions, oldest first, that lie between the known ones."""
        self.entered = self.newest
        for session in recorded:
            if self.session < session < self.newest and not self.knows(session):
                self._ends[session] = 0
                self._later.insert(next(n for n, later in enumerate(self._later) if later > session), session)

    @property
    def over(self) -> bool:
        """True if a later session has begun."""
        return bool(self._later)

    def hole(self) -> Hole | None:
        """The first hole, or ``None``."""
        held = self._held.get(self.session)
        end = held[0].sequence if held else self._ends[self.session]
        if end > self.following:
            return Hole(self.session, self.following, end - self.following, certain=bool(held) or self.over)
        return Hole(self.session, self.following, None, certain=True) if self.over else None

    def fill(self, part: Message) -> list[Message]:
        """Add an answer to ``hole``. If it begins later than requested, the messages before it are lost."""
        lost: list[Message] = []
        if part.session == self.session and part.sequence > self.following:
            lost = self._lost(part.sequence, "no longer in the record of the cell")
        return lost + self.take(part)

    def give_up(self, hole: Hole, reason: str) -> list[Message]:
        """Give up ``hole``, whose messages the cell no longer has; return the gap and the messages after it."""
        if (hole.session, hole.first) != (self.session, self.following):
            return []
        if hole.count is not None:
            return self._lost(hole.first + hole.count, reason)
        self._past.append(self.session)
        del self._ends[self.session]
        self._held.pop(self.session, None)
        self.session, self.following = self._later.pop(0), 0
        return self._ready()

    def _lost(self, end: int, reason: str) -> list[Message]:
        count = end - self.following
        gap = Message(self.topic, self.session, self.following, True, Gap(count, reason))
        self.following = end
        return [gap, *self._ready()]

    def _ready(self) -> list[Message]:
        ready: list[Message] = []
        held = self._held.get(self.session, [])
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
