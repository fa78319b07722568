"""What a consumer of one cell has, lacks and must ask for; pure, the time is handed in.

A consumer that begins takes each topic from where it is. From then on it is owed everything: a topic that
appears later, or a new session of the daemon, is owed from its first number.

What goes on from what is known is believed. A new topic, a new session or a leap is believed once the cell has said
so when asked (``asks_told``, ``told``); what it then does not know is refused and counted.
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
from cellwatt.publish.asking import Question
from cellwatt.publish.doubt import Doubts
from cellwatt.publish.keys import ALARM
from cellwatt.publish.mark import Mark
from cellwatt.publish.order import Follower, Gap, Hole, Part
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

    ``wanted`` are topics or first parts of topics (``raw/arm``). ``resume``: where an earlier run of the consumer
    got to. ``patience``: time, s, after which what the cell cannot give is called a gap.
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
        """Whether a topic is followed."""
        return any(topic == wanted or topic.startswith(f"{wanted}/") for wanted in self.wanted)

    @property
    def begun(self) -> dict[str, tuple[int, int]]:
        """By topic, session and number of the first that is owed to this consumer."""
        return {name: topic.begun for name, topic in list(self._topics.items())}

    @property
    def duplicates(self) -> int:
        """Samples and messages that came more than once and were delivered once."""
        return sum(t.follower.duplicates for t in list(self._topics.values()))

    def message(self, topic: str, mark: Mark, content: Batch | Frames | Result | Event, size: int = 0) -> list[Part]:
        """A live message of ``size`` bytes came; gives what is in order now.

        Raises ``ProtocolError`` where somebody makes up more topics than a cell can have.
        """
        part = _part(mark, content, backfilled=False, size=size)
        state = self._topics.get(topic)
        if state is None and not self.joined:
            state = self._begin(topic, mark.session, mark.sequence)
        if state is not None and _goes_on(state, part):
            return self._counted(state.follower.take(part))
        if not self._doubts.add(topic, part):
            self.counts["let go"] += 1
        return []

    def hinted(self, positions: Positions) -> None:
        """A live health message says how far the cell has published: reason to ask it, no more."""
        for topic, (session, end) in positions.items():
            state = self._topics.get(topic)
            reach = None if state is None else state.follower.reach(session)
            if self.wants(topic) and (reach is None or end > reach) and len(self._doubts.claims) < _MOST_TOPICS:
                self._doubts.claims[topic] = session, end

    def doubt(self) -> None:
        """Something else came that only the cell can confirm: reason to ask it."""
        self._unsure = True

    def asks_told(self, now: float) -> bool:
        """Whether to ask the cell how far it is; then waits for ``told`` or ``untold``."""
        self._doubts.claims = {t: claim for t, claim in self._doubts.claims.items() if not self._reached(t, *claim)}
        return self._doubts.asks(now, anyhow=self._unsure)

    def untold(self, now: float) -> None:
        """Nobody answered how far the cell is."""
        self._doubts.unanswered(now)

    def told(self, session: int, positions: Positions, now: float) -> list[tuple[str, Part]]:
        """The cell said when asked, in a session of the daemon, how far it has published; gives what is in order."""
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
        """Begin with a topic that the cell has; 1 where it began with what the cell does not know, and begins anew."""
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
        """An alarm that is active now came as an answer; given if it was raised before this consumer began."""
        state = self._topics.get(ALARM)
        if state is None or mark.session != state.begun[0] or mark.end > state.begun[1]:
            return []
        return self._counted([_part(mark, alarm, backfilled=True)])

    def questions(self, now: float) -> list[Question]:
        """What to ask now; each waits for ``filled``, ``nothing`` or ``unanswered``."""
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
        """Whether to ask which sessions were recorded, because one ended; then waits for ``sessions``."""
        if now < self._sessions_due or not any(self._unchecked(name, state) for name, state in self._topics.items()):
            return False
        self._sessions_due = math.inf
        return True

    def sessions(self, recorded: Sequence[int] | None, now: float) -> None:
        """The sessions of which there are recordings, oldest first; ``None`` where nobody answered."""
        self._sessions_due = now + _LINK
        if recorded is None:
            return
        for name, state in self._topics.items():
            if self._unchecked(name, state):
                follower = state.follower
                follower.between([s for s in recorded if follower.session < s < follower.newest])
                self._checked.add((name, follower.newest))

    def _unchecked(self, name: str, state: _Topic) -> bool:
        """Whether a recorded topic goes over into a session before which there may have been others."""
        follower = state.follower
        return follower.over and name.startswith("raw/") and (name, follower.newest) not in self._checked

    @property
    def complete(self) -> bool:
        """Whether nothing is missing as far as is known."""
        return all(t.follower.hole() is None for t in self._topics.values())

    def filled(self, question: Question, parts: Iterable[tuple[Mark, Batch | Frames | Result | Event]]) -> list[Part]:
        """The cell answered with these, in order."""
        state = self._answered(question)
        state.empty_since = None
        ready = [p for mark, content in parts for p in state.follower.fill(_part(mark, content, backfilled=True))]
        rest = state.follower.hole()
        state.seen, state.due = None if rest is None else _key(rest), -math.inf
        return self._counted(ready)

    def nothing(self, question: Question, reason: str, now: float) -> list[Part]:
        """The cell answered that it has nothing of that."""
        state = self._answered(question)
        if state.empty_since is None:
            state.empty_since = now
        if not state.follower.over and now - state.empty_since < self.patience:
            state.due = now + _AGAIN
            return []
        state.empty_since = None
        return self._counted(state.follower.give_up(question.hole, reason))

    def unanswered(self, question: Question, now: float) -> None:
        """Nobody answered."""
        self._answered(question).due = now + _LINK

    def _meet(self, topic: str, session: int, number: int) -> _Topic:
        """Begin with a topic as it is; once joined, at its first number of all since then."""
        if not self.joined:
            return self._begin(topic, session, number)
        return self._begin(topic, self._since or session if topic.startswith("raw/") else session, 0)

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


def _goes_on(state: _Topic, part: Part) -> bool:
    """Whether a part follows, or repeats, what is known to exist."""
    reach = state.follower.reach(part.session)
    return reach is not None and part.sequence <= reach


def _ended(state: _Topic, part: Part, session: int) -> bool:
    """Whether a part is of a session that may have been between the last one known and this one, or ended with it."""
    follower = state.follower
    reach = follower.reach(part.session)
    between = reach is None and follower.newest < part.session < session
    ended = reach is not None and part.session == follower.newest != session
    return (between or ended) and part.sequence - (reach or 0) <= _NEAR


def _part(mark: Mark, content: Batch | Frames | Result | Event, backfilled: bool, size: int = 0) -> Part:
    return Part(mark.session, mark.sequence, mark.count, backfilled, content, size)
