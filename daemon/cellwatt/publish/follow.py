"""What a consumer of one cell has, lacks and must ask for; pure, the time is handed in.

A consumer that begins takes each topic from where it is. From then on it is owed everything: a topic that
appears later, or a new session of the daemon, is owed from its first number.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames
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

Positions = Mapping[str, tuple[int, int]]
"""By topic, session and next number."""


@dataclass(frozen=True, slots=True)
class Question:
    """What to ask the cell for."""

    topic: str
    hole: Hole


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

    def message(self, topic: str, mark: Mark, content: Batch | Frames | Result | Event) -> list[Part]:
        """A live message came; gives what is in order now."""
        state = self._topics.get(topic) or self._meet(topic, mark.session, mark.sequence)
        return self._counted(state.follower.take(_part(mark, content, backfilled=False)))

    def beat(self, session: int, positions: Positions) -> None:
        """The cell said, in a session of the daemon, how far it has published."""
        for topic, (numbering, end) in positions.items():
            if not self.wants(topic):
                continue
            state = self._topics.get(topic) or self._meet(topic, numbering, end)
            state.follower.announce(numbering, end)
        if not self.joined:
            self.joined, self._since = True, session

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


def _part(mark: Mark, content: Batch | Frames | Result | Event, backfilled: bool) -> Part:
    return Part(mark.session, mark.sequence, mark.count, backfilled, content)
