"""The state of a consumer: which messages it has, which are missing, what to ask the cell. Pure; time is passed in.

A new consumer takes each topic from its current position. From then on it receives everything: a topic that appears
later, or a new session of the daemon, from its first number.

A message that continues a known numbering is accepted. A new topic, a new session or a jump is accepted once the cell
has confirmed it (``asks_told``, ``told``); a message that the cell does not know is refused and counted.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.keys import ALARM, HEALTH
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Doubts, Follower, Gap, Hole, Part
from cellwatt.outlets.zenoh.questions import Question
from cellwatt.results import Alarm, Event, Result

GRACE: Final = 0.2
"""Time, s, that announced messages may still be on their way before they are asked for."""
_AGAIN: Final = 0.2
"""Pause, s, before asking for what the cell does not have yet."""
_LINK: Final = 0.5
"""Pause, s, before asking again when nobody answered."""
_MOST_TOPICS: Final = 1000
"""Topics that are followed; a cell has some ten."""
_NEAR: Final = 10_000
"""Numbers by which what came of a session that ended at once may lie beyond what is known of it."""

Positions = Mapping[str, tuple[int, int]]
"""By topic, session and next number."""


@dataclass(slots=True)
class _Topic:
    follower: Follower
    begun: tuple[int, int]
    asking: bool = False
    seen: tuple[int, int, bool] | None = None  # the hole that ``due`` belongs to
    due: float = 0.0
    empty_since: float | None = None  # since when the cell has answered that it has nothing


@dataclass(slots=True)
class Following:
    """State of one consumer.

    ``wanted`` are topics or first parts of topics (``raw/arm``). ``resume`` is the position that an earlier run of
    the consumer reached. After ``patience`` s, messages that the cell cannot give become a gap.
    """

    wanted: tuple[str, ...]
    resume: Positions = field(default_factory=dict)
    patience: float = 5.0
    joined: bool = False
    counts: Counter[str] = field(default_factory=Counter)
    _topics: dict[str, _Topic] = field(default_factory=dict)
    _checked: set[tuple[str, int]] = field(default_factory=set)
    _sessions_due: float = -math.inf
    _since: int | None = None  # session of the daemon in which this consumer joined
    _unsure: bool = True  # whether there is reason to ask the cell though nothing waits for it
    _doubts: Doubts = field(default_factory=Doubts)

    def __post_init__(self) -> None:
        self.joined = bool(self.resume)
        for topic, (session, following) in self.resume.items():
            self._begin(topic, session, following)
            if topic.startswith("raw/"):
                self._since = session

    def wants(self, topic: str) -> bool:
        """True if the consumer follows a topic."""
        return any(topic == wanted or topic.startswith(f"{wanted}/") for wanted in self.wanted)

    @property
    def begun(self) -> dict[str, tuple[int, int]]:
        """Session and number of the first message that this consumer should get, by topic."""
        return {name: topic.begun for name, topic in list(self._topics.items())}

    @property
    def duplicates(self) -> int:
        """Number of samples and messages that arrived more than once; each was delivered once."""
        return sum(t.follower.duplicates for t in list(self._topics.values()))

    def message(self, topic: str, mark: Mark, content: Batch | Frames | Result | Event, size: int = 0) -> list[Part]:
        """Take a live message of ``size`` bytes; return the parts that are in order now.

        Raises ``ProtocolError`` if there are more topics than a cell can have.
        """
        part = _part(mark, content, backfilled=False, size=size)
        state = self._topics.get(topic)
        if state is None and not self.joined:
            state = self._begin(topic, mark.session, mark.sequence)
        if state is not None and mark.session == state.begun[0] and mark.end <= state.begun[1]:
            return []  # it is older than what this consumer began with
        if state is not None and _goes_on(state, part):
            return self._counted(state.follower.take(part))
        if not self._doubts.add(topic, part):
            self.counts["let go"] += 1
        return []

    def hinted(self, positions: Positions) -> None:
        """Take the positions in a live health message, which are only a reason to ask the cell."""
        for topic, (session, end) in positions.items():
            state = self._topics.get(topic)
            reach = None if state is None else state.follower.reach(session)
            if self.wants(topic) and (reach is None or end > reach) and len(self._doubts.claims) < _MOST_TOPICS:
                self._doubts.claims[topic] = session, end

    def doubt(self) -> None:
        """Note another message that only the cell can confirm."""
        self._unsure = True

    def asks_told(self, now: float) -> bool:
        """True if the cell should be asked for its positions now; call ``told`` or ``untold`` next."""
        self._doubts.claims = {t: claim for t, claim in self._doubts.claims.items() if not self._reached(t, *claim)}
        return self._doubts.asks(now, anyhow=self._unsure)

    def untold(self, now: float) -> None:
        """Note that no answer about the cell's positions came."""
        self._doubts.unanswered(now)

    def told(self, session: int, positions: Positions, now: float) -> list[tuple[str, Part]]:
        """Take the cell's answer, the positions of a daemon session; return the parts in order now, by topic."""
        doubted, claims = self._doubts.answered()
        wanted = {topic: place for topic, place in positions.items() if self.wants(topic)}
        ready: list[tuple[str, Part]] = []
        refused = 0
        for topic in {**wanted, **doubted}:
            numbering, end = wanted.get(topic, (session, None))
            if end is not None:
                refused += self._meet_told(topic, numbering, end, doubted.get(topic, ()))
            state = self._topics.get(topic)
            late = []
            for part in doubted.get(topic, ()):
                if state is not None and _ended(state, part, numbering):
                    ready += self._take(topic, part)
                else:
                    late.append(part)
            if state is not None and end is not None:
                state.follower.announce(numbering, end)
            for part in late:
                if state is not None and _goes_on(state, part):
                    ready += self._take(topic, part)
                else:
                    refused += 1
        if not self.joined:
            self.joined, self._since = True, session
        self._unsure = False
        refused += sum(not self._reached(topic, *claim) for topic, claim in claims.items())
        for topic, parts in self._doubts.drain().items():  # came since the cell was asked
            for part in parts:
                state = self._topics.get(topic)
                if state is not None and _goes_on(state, part):
                    ready += self._take(topic, part)
                else:
                    self._doubts.add(topic, part)
        if refused:
            self.counts["refused"] += refused
        self._doubts.judged(now, refused > 0)
        return ready

    def _meet_told(self, topic: str, numbering: int, end: int, doubted: Sequence[Part]) -> int:
        """Start a topic that the cell has. Return 1 if it had started from a position unknown to the cell, else 0."""
        state = self._topics.get(topic)
        if state is None:
            self._meet(topic, numbering, end)
        elif not self.joined and (state.follower.session != numbering or state.follower.following > end + _NEAR):
            first = (part.sequence for part in doubted if part.session == numbering and part.end <= end)
            self._begin(topic, numbering, min(first, default=end))
            return 1
        return 0

    def _take(self, topic: str, part: Part) -> list[tuple[str, Part]]:
        return [(topic, given) for given in self._counted(self._topics[topic].follower.take(part))]

    def _reached(self, topic: str, session: int, end: int) -> bool:
        state = self._topics.get(topic)
        reach = None if state is None else state.follower.reach(session)
        return reach is not None and end <= reach

    def standing(self, mark: Mark, alarm: Alarm) -> list[Part]:
        """Take an active alarm from an answer; return it if it was raised before this consumer began."""
        state = self._topics.get(ALARM)
        if state is None or mark.session != state.begun[0] or mark.end > state.begun[1]:
            return []
        return self._counted([_part(mark, alarm, backfilled=True)])

    def questions(self, now: float) -> list[Question]:
        """Questions to ask now; after each call ``filled``, ``nothing`` or ``unanswered``."""
        due = []
        for name, state in self._topics.items():
            hole = None if state.asking else state.follower.hole()
            if hole is None or self._unchecked(name, state):
                continue
            if state.seen != _key(hole):
                state.seen = _key(hole)
                state.due = now if hole.certain else now + GRACE
            if now >= state.due:
                state.asking = True
                due.append(Question(name, hole))
        return due

    def asks_sessions(self, now: float) -> bool:
        """True if a session has ended and the recorded sessions should be asked for; call ``sessions`` next."""
        if now < self._sessions_due or not any(self._unchecked(name, state) for name, state in self._topics.items()):
            return False
        self._sessions_due = math.inf
        return True

    def sessions(self, recorded: Sequence[int] | None, now: float) -> None:
        """Take the recorded sessions, oldest first; ``None`` if no answer came."""
        self._sessions_due = now + _LINK
        if recorded is None:
            return
        for name, state in self._topics.items():
            if self._unchecked(name, state):
                follower = state.follower
                follower.between([s for s in recorded if follower.session < s < follower.newest])
                self._checked.add((name, follower.newest))

    def _unchecked(self, name: str, state: _Topic) -> bool:
        """True if a recorded topic enters a session that other sessions may have preceded."""
        follower = state.follower
        return follower.over and _recorded(name) and (name, follower.newest) not in self._checked

    @property
    def complete(self) -> bool:
        """True if no message is known to be missing."""
        return all(t.follower.hole() is None for t in self._topics.values())

    def filled(self, question: Question, parts: Iterable[tuple[Mark, Batch | Frames | Result | Event]]) -> list[Part]:
        """Take the cell's answer to a question; return the parts that are in order now."""
        state = self._answered(question)
        state.empty_since = None
        ready = [p for mark, content in parts for p in state.follower.fill(_part(mark, content, backfilled=True))]
        rest = state.follower.hole()
        state.seen, state.due = None if rest is None else _key(rest), -math.inf
        return self._counted(ready)

    def nothing(self, question: Question, reason: str, now: float) -> list[Part]:
        """Note that the cell has none of the messages; return the gap and the parts after it, when due."""
        state = self._answered(question)
        if state.empty_since is None:
            state.empty_since = now
        if not state.follower.over and now - state.empty_since < self.patience:
            state.due = now + _AGAIN
            return []
        state.empty_since = None
        return self._counted(state.follower.give_up(question.hole, reason))

    def unanswered(self, question: Question, now: float) -> None:
        """Note that no answer came."""
        self._answered(question).due = now + _LINK

    def _meet(self, topic: str, session: int, number: int) -> _Topic:
        """Start a topic at its current position, or after the join at its first number."""
        if not self.joined:
            return self._begin(topic, session, number)
        return self._begin(topic, self._since or session if _recorded(topic) else session, 0)

    def _begin(self, topic: str, session: int, following: int) -> _Topic:
        if topic not in self._topics and len(self._topics) >= _MOST_TOPICS:
            raise ProtocolError(f"more than {_MOST_TOPICS} topics of one cell")
        state = self._topics[topic] = _Topic(Follower(session, following), (session, following))
        return state

    def _answered(self, question: Question) -> _Topic:
        state = self._topics[question.topic]
        state.asking = False
        return state

    def _counted(self, parts: list[Part]) -> list[Part]:
        for part in parts:
            what = "lost" if isinstance(part.content, Gap) else "backfilled" if part.backfilled else "live"
            self.counts[what] += part.count
        return parts


def _key(hole: Hole) -> tuple[int, int, bool]:
    return hole.session, hole.first, hole.certain


def _recorded(topic: str) -> bool:
    """True for topics that the record holds under their numbers."""
    return topic not in (ALARM, HEALTH)


def _goes_on(state: _Topic, part: Part) -> bool:
    """True if a part continues or repeats messages that are known to exist."""
    reach = state.follower.reach(part.session)
    return reach is not None and part.sequence <= reach


def _ended(state: _Topic, part: Part, session: int) -> bool:
    """True if a part is of the last known session or a later one, and that session ended before ``session``."""
    follower = state.follower
    reach = follower.reach(part.session)
    between = reach is None and follower.newest < part.session < session
    ended = reach is not None and part.session == follower.newest != session
    return (between or ended) and part.sequence - (reach or 0) <= _NEAR


def _part(mark: Mark, content: Batch | Frames | Result | Event, backfilled: bool, size: int = 0) -> Part:
    return Part(mark.session, mark.sequence, mark.count, backfilled, content, size)
