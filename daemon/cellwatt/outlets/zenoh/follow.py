"""The state of a consumer: messages received, messages missing, questions to the cell. Pure; time is an argument.

A new consumer begins each topic at its current position. From then on it receives everything: a topic that appears
later, or a new session of the daemon, from its first number.

A message that continues a known numbering is accepted. A new topic, a new session or a jump, in a live message or a
live health message, is a claim: the cell is asked for its positions (``asks_told``, ``told``); a claim beyond the
cell's positions is refused and counted.
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
"""Most topics followed (a cell has some ten), and most claims that wait for the cell's answer."""
_NEAR: Final = 10_000
"""Most numbers by which the first message of a topic may exceed the cell's position, and the last message of a
session the known end of the session."""

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
    _claims: dict[tuple[str, int], int] = field(default_factory=dict)
    """Highest claimed next number, by topic and session; the topic of a claimed daemon session is ``health``."""
    _asked: dict[tuple[str, int], int] = field(default_factory=dict)
    _early: list[Message] = field(default_factory=list)
    """Messages of topics that the cell has not confirmed yet."""
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
        follower = self._topics.get(topic)
        # Before the cell has answered anyone may have sent it: half of the room is for the cell's own topics.
        if follower is None and not self.joined and len(self._topics) < _MOST // 2:
            follower = self._begin(topic, mark.session, mark.sequence)
        known = follower is not None and follower.knows(mark.session, mark.sequence)
        if not known and not self._claim(topic, mark.session, mark.end):
            return []
        part = Message(topic, mark.session, mark.sequence, False, content, size)
        if follower is None:
            if len(self._early) < _MOST and sum(part.size for part in self._early) + size <= HELD_BYTES:
                self._early.append(part)
            return []
        if mark.session == follower.begun[0] and mark.end <= follower.begun[1]:
            return []  # older than the first message of this consumer
        return self._counted(follower.take(part))

    # positions of the cell --------------------------------------------------------------------------

    def hinted(self, session: int, positions: Positions) -> None:
        """Add the session and the positions of a live health message as claims, on which the cell is asked."""
        if self.cell is not None:
            self._claim(HEALTH, session, 0)
        for topic, (numbering, end) in positions.items():
            if self.wants(topic):
                self._claim(topic, numbering, end)

    def _claim(self, topic: str, session: int, end: int) -> bool:
        """Add a claim that only the cell can confirm; return False if there are too many."""
        if self._confirmed(topic, session, end):
            return True
        if (topic, session) not in self._claims and len(self._claims) >= _MOST:
            self.counts["let go"] += 1
            return False
        self._claims[topic, session] = max(end, self._claims.get((topic, session), 0))
        return True

    def _confirmed(self, topic: str, session: int, end: int) -> bool:
        if topic == HEALTH:
            return session == self.cell
        return topic in self._topics and self._topics[topic].knows(session, end)

    def asks_told(self, now: float) -> bool:
        """True if the cell should be asked for its positions now; call ``told`` or ``untold`` next."""
        if now < self._due:
            return False
        self._claims = {claim: end for claim, end in self._claims.items() if not self._confirmed(*claim, end)}
        if self.cell is not None and not self._claims:
            return False
        self._asked, self._due = dict(self._claims), math.inf
        return True

    def untold(self, now: float) -> None:
        """Note that the question for the cell's positions was not answered."""
        self._pause = min(2 * self._pause, _LONGEST)
        self._due = now + self._pause

    def told(self, session: int, positions: Positions, now: float) -> list[Message]:
        """Process the cell's answer, the positions of a daemon session; return the messages now in order.

        Claims beyond these positions are refused. Raises ``ProtocolError`` if there are more topics than a cell can
        have; then the cell is asked again.
        """
        refused, self._due = 0, now + self._pause
        for topic, (numbering, end) in positions.items():
            if self.wants(topic):
                refused += self._meet(topic, numbering, end)
                follower = self._topics[topic]
                claimed, known = self._asked.get((topic, follower.newest), 0), follower.reach(follower.newest) or 0
                if numbering != follower.newest and claimed <= known + _NEAR:  # claims of a session that has just ended
                    follower.announce(follower.newest, claimed)
                follower.announce(numbering, end)
        self.cell = session
        if not self.joined:
            self.joined, self._since = True, session
        early, self._early = [part for part in self._early if part.topic in self._topics], []
        ready = [given for part in early for given in self._counted(self._topics[part.topic].take(part))]
        for (topic, numbering), end in self._asked.items():
            if not self._confirmed(topic, numbering, end):
                refused += 1
                if topic in self._topics:
                    self._topics[topic].refuse(numbering, end)
        self._claims = {claim: end for claim, end in self._claims.items() if end != self._asked.get(claim)}
        self._pause = min(2 * self._pause, _LONGEST) if refused else _PAUSE
        self._due = now + self._pause
        self.counts += Counter(refused=refused)
        return ready

    def _meet(self, topic: str, numbering: int, end: int) -> int:
        """Begin a topic of the cell at its current position, or, after joining, at its first number.

        Return 1 if the topic had begun at a position unknown to the cell, else 0.
        """
        follower = self._topics.get(topic)
        if follower is None and self.joined:
            self._begin(topic, self._since or numbering if _recorded(topic) else numbering, 0)
        elif follower is None:
            self._begin(topic, numbering, end)
        elif not self.joined and (follower.session != numbering or follower.following > end + _NEAR):
            self._begin(topic, numbering, end)
            return 1
        return 0

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
