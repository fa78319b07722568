"""The state of a consumer: messages received, messages missing, questions to the cell. Pure; time is an argument.

A new consumer begins each topic at its current position. From then on it receives everything: a topic that appears
later, or a new session of the daemon, from its first number.

A new topic or session is entered once the cell names it in its answer (``asks_told``, ``told``): a message that was
late, or that a router sends again, must not end the session of the running daemon.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Final

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.keys import ALARM, HEALTH
from cellwatt.outlets.zenoh.mark import Mark, Positions
from cellwatt.outlets.zenoh.order import HELD_BYTES, Follower, Gap, Hole, Message
from cellwatt.outlets.zenoh.questions import Question
from cellwatt.results import Alarm, Event, Result

GRACE: Final = 0.2
"""Time, s, that announced messages may be in transit before they are requested."""
_AGAIN: Final = 0.2
"""Pause, s, before requesting again messages that the cell does not have yet."""
_LINK: Final = 0.5
"""Pause, s, before asking again after no answer."""
_PAUSE: Final = 0.1
_LONGEST: Final = 2.0
"""Longest pause, s, between two questions for the cell's positions; doubled from ``_PAUSE`` after each failure."""
_MOST: Final = 1000
"""Most topics followed (a cell has some ten), and most messages held of other topics."""

Content = Batch | Frames | Result | Event


@dataclass(slots=True)
class Following:
    """State of one consumer.

    ``wanted`` are topics or prefixes of topics (``raw/arm``). ``resume`` is the position that an earlier run of the
    consumer reached. After ``patience`` s, messages that the cell does not have become a gap. ``cell`` is the session
    of the daemon, once the cell has reported it.
    """

    wanted: tuple[str, ...]
    resume: Positions = field(default_factory=dict)
    patience: float = 5.0
    joined: bool = False
    cell: int | None = None
    counts: Counter[str] = field(default_factory=Counter)
    _topics: dict[str, Follower] = field(default_factory=dict)
    _since: int | None = None  # session of the daemon in which this consumer joined
    _sessions_due: float = -math.inf
    _unsure: bool = True
    """True until the cell has named its session, and if a topic or session arrived that it has not named."""
    _early: list[Message] = field(default_factory=list)
    """Messages of topics that the cell has not named yet."""
    _due: float = -math.inf
    _pause: float = _PAUSE

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
        """Session and number of the first message that this consumer receives, by topic."""
        return {name: follower.begun for name, follower in list(self._topics.items())}

    @property
    def duplicates(self) -> int:
        """Number of samples and messages that arrived more than once; each was delivered once."""
        return sum(follower.duplicates for follower in list(self._topics.values()))

    def message(self, topic: str, mark: Mark, content: Content, size: int = 0) -> list[Message]:
        """Add a live message of ``size`` bytes; return the messages that are now in order."""
        part = Message(topic, mark.session, mark.sequence, False, content, size)
        follower = self._topics.get(topic)
        if follower is None and self.joined:
            self._unsure = True
            if len(self._early) < _MOST and sum(part.size for part in self._early) + size <= HELD_BYTES:
                self._early.append(part)
            return []
        if follower is None:
            follower = self._begin(topic, mark.session, mark.sequence)
        if mark.session == follower.begun[0] and mark.end <= follower.begun[1]:
            return []  # older than the first message of this consumer
        self._unsure |= not follower.knows(mark.session)
        return self._counted(follower.take(part))

    # positions of the cell --------------------------------------------------------------------------

    def hinted(self, session: int, positions: Positions) -> None:
        """Process the session and the positions of a live health message."""
        self._unsure |= session != self.cell
        for topic, (numbering, end) in positions.items():
            follower = self._topics.get(topic)
            if follower is not None and follower.knows(numbering):
                follower.announce(numbering, end)
            elif self.wants(topic):
                self._unsure = True

    def asks_told(self, now: float) -> bool:
        """True if the cell should be asked for its positions now; call ``told`` or ``untold`` next."""
        if now < self._due or not self._unsure:
            return False
        self._due = math.inf
        return True

    def untold(self, now: float) -> None:
        """Note that the question for the cell's positions was not answered."""
        self._pause = min(2 * self._pause, _LONGEST)
        self._due = now + self._pause

    def told(self, session: int, positions: Positions, now: float) -> list[Message]:
        """Process the cell's answer, the positions of a daemon session; return the messages now in order.

        Raises ``ProtocolError`` if there are more topics than a cell can have; then the cell is asked again.
        """
        self._due = now + _LINK
        for topic, (numbering, end) in positions.items():
            if self.wants(topic):
                self._meet(topic, numbering, end).announce(numbering, end)
        self.cell = session
        if not self.joined:
            self.joined, self._since = True, session
        for follower in self._topics.values():
            follower.release_unknown()
        self._unsure, self._pause = False, _PAUSE
        early, self._early = [part for part in self._early if part.topic in self._topics], []
        return [given for part in early for given in self._counted(self._topics[part.topic].take(part))]

    def _meet(self, topic: str, numbering: int, end: int) -> Follower:
        """Begin a topic of the cell at its current position, or, after joining, at its first number."""
        follower = self._topics.get(topic)
        if follower is None and self.joined:
            return self._begin(topic, self._since or numbering if _recorded(topic) else numbering, 0)
        if follower is None or not (self.joined or follower.knows(numbering)):
            return self._begin(topic, numbering, end)
        return follower

    def standing(self, mark: Mark, alarm: Alarm) -> list[Message]:
        """Return an active alarm from an answer, if it was raised before this consumer began."""
        follower = self._topics.get(ALARM)
        if follower is None or mark.session != follower.begun[0] or mark.end > follower.begun[1]:
            return []
        return self._counted([Message(ALARM, mark.session, mark.sequence, True, alarm)])

    # missing messages -------------------------------------------------------------------------------

    def questions(self, now: float) -> list[Question]:
        """Questions to ask now; for each, call ``filled``, ``nothing`` or ``unanswered`` afterwards."""
        due = []
        for name, follower in self._topics.items():
            hole = None if follower.asking else follower.hole()
            if hole is None or _unentered(follower):
                continue
            if follower.asked_about != _key(hole):
                follower.asked_about = _key(hole)
                follower.due = now if hole.certain else now + GRACE
            if now >= follower.due:
                follower.asking = True
                due.append(Question(name, hole))
        return due

    def asks_sessions(self, now: float) -> bool:
        """True if a session has ended and the recorded sessions should be requested; call ``sessions`` next."""
        if now < self._sessions_due or not any(map(_unentered, self._topics.values())):
            return False
        self._sessions_due = math.inf
        return True

    def sessions(self, recorded: Sequence[int] | None, now: float) -> None:
        """Process the recorded sessions, oldest first; ``None``: no answer."""
        self._sessions_due = now + _LINK
        for follower in self._topics.values() if recorded is not None else ():
            if _unentered(follower):
                follower.between(recorded or ())

    def filled(self, question: Question, parts: Iterable[tuple[Mark, Content]]) -> list[Message]:
        """Process the cell's answer to a question; return the messages that are now in order."""
        follower = self._answered(question)
        follower.empty_since = None
        told = (Message(question.topic, mark.session, mark.sequence, True, content) for mark, content in parts)
        ready = [given for part in told for given in follower.fill(part)]
        rest = follower.hole()
        follower.asked_about, follower.due = None if rest is None else _key(rest), -math.inf
        return self._counted(ready)

    def nothing(self, question: Question, reason: str, now: float) -> list[Message]:
        """Note that the cell has none of the messages; after ``patience``, return the gap and the messages after it."""
        follower = self._answered(question)
        if follower.empty_since is None:
            follower.empty_since = now
        if not follower.over and now - follower.empty_since < self.patience:
            follower.due = now + _AGAIN
            return []
        follower.empty_since = None
        return self._counted(follower.give_up(question.hole, reason))

    def unanswered(self, question: Question, now: float) -> None:
        """Note that a question was not answered."""
        self._answered(question).due = now + _LINK

    def _begin(self, topic: str, session: int, following: int) -> Follower:
        if topic not in self._topics and len(self._topics) >= _MOST:
            raise ProtocolError(f"more than {_MOST} topics of one cell")
        follower = self._topics[topic] = Follower(topic, session, following)
        return follower

    def _answered(self, question: Question) -> Follower:
        follower = self._topics[question.topic]
        follower.asking = False
        return follower

    def _counted(self, parts: list[Message]) -> list[Message]:
        for part in parts:
            what = "lost" if isinstance(part.content, Gap) else "backfilled" if part.backfilled else "live"
            self.counts[what] += part.count
        return parts


def _key(hole: Hole) -> tuple[int, int, bool]:
    return hole.session, hole.first, hole.certain


def _recorded(topic: str) -> bool:
    """True for topics that the record stores under the same numbers."""
    return topic not in (ALARM, HEALTH)


def _unentered(follower: Follower) -> bool:
    """True if a recorded topic enters a new session and sessions in between may be unknown."""
    return follower.over and _recorded(follower.topic) and follower.entered != follower.newest
