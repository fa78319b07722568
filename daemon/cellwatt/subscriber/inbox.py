"""Live messages and answers of one cell, put in order for the consumer.

Zenoh calls back in threads of its own. One of them at a time works here, as quickly as decoding allows, and never
calls Zenoh.
"""

from __future__ import annotations

import contextlib
import logging
import math
import threading
import time
from collections import Counter
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.encode import schema_in
from cellwatt.outlets.zenoh.follow import Following
from cellwatt.outlets.zenoh.keys import ALARM, HEALTH, Address, parse
from cellwatt.outlets.zenoh.mailbox import Mailbox
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Part
from cellwatt.outlets.zenoh.questions import Question
from cellwatt.outlets.zenoh.received import (
    Health,
    UnknownSchemaError,
    read_answer,
    read_health,
    read_message,
    read_refusal,
    read_sessions,
)
from cellwatt.outlets.zenoh.signing import Witness
from cellwatt.results import Alarm
from cellwatt.subscriber.message import Message

if TYPE_CHECKING:
    import zenoh
import zlib
from typing import TYPE_CHECKING

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


log = logging.getLogger("cellwatt.subscriber")

_QUEUE_BYTES: Final = 256 * 1024 * 1024  # of messages that wait for the consumer
_QUIET: Final = 10.0  # s, least time between two log lines about bad messages


class Inbox:
    """Puts messages that ``witness`` accepts in order and into ``mailbox``, and sets ``look`` if some may be missing.

    ``following`` is to be used under ``lock``. ``queue_size`` messages may wait; beyond that, live ones are let go.
    Health is delivered if ``health`` is set.
    """

    def __init__(
        self, following: Following, witness: Witness, counts: Counter[str], queue_size: int, health: bool
    ) -> None:
        self.following = following
        self.witness = witness
        self.counts = counts
        self._schemas = Schemas()
        self.mailbox: Mailbox[Message] = Mailbox(queue_size, _QUEUE_BYTES)
        self.lock = threading.Lock()
        self.look = threading.Event()
        self._wants_health = health
        self._health_reached = (0, 0)
        self._cell: int | None = None  # session of the daemon, as confirmed by the cell
        self._stranger: tuple[Mark, Health] | None = None  # health of a session that the cell has not confirmed
        self._asked_about: tuple[Mark, Health] | None = None
        self._warned_at = -math.inf

    @contextlib.contextmanager
    def guarded(self) -> Iterator[None]:
        """Let one thread at a time in, and pass errors on to the consumer, since Zenoh would swallow them."""
        with self.lock:
            try:
                with self._counted():
                    yield
            except Exception as error:
                self.mailbox.end(error)

    def status_is_asked(self) -> None:
        """Note that the next status answers about the unconfirmed health message held now. Call it under ``lock``."""
        self._asked_about = self._stranger

    # live messages ----------------------------------------------------------------------------------

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Take a live message."""
        with self.guarded():
            if self.mailbox.full:
                self.counts["let go"] += 1
                return
            address = parse(str(sample.key_expr))
            if not self.witness.message(address.topic, sample):
                return
            if address.kind == HEALTH:
                mark, health = read_health(sample)
                if self.witness.newer(mark, self._health_reached):
                    self._on_health(mark, health)
                return
            self._take(address, sample)

    def _take(self, address: Address, sample: zenoh.Sample) -> None:
        topic = address.topic
        try:
            mark, content = read_message(sample, address.kind, self._schemas.of(topic))
        except UnknownSchemaError:
            self.counts["let go"] += not self._schemas.hold(topic, sample)
            return
        if isinstance(content, Batch | Frames) and not mark.schema:
            for waited in self._schemas.learn(topic, schema_in(sample.payload.to_bytes())):
                with self._counted():
                    self._take(address, waited)
        ready = self.following.message(topic, mark, content, len(sample.payload))
        self._deliver(topic, ready)
        if not ready:
            self.look.set()

    def _on_health(self, mark: Mark, health: Health) -> None:
        self.following.hinted(health.positions)
        if self._cell in (None, health.session):
            self._deliver_health(mark, health)
        else:
            self._stranger = mark, health
            self.following.doubt()
        self.look.set()

    # answers, under ``guarded`` ---------------------------------------------------------------------

    def on_status(self, replies: list[zenoh.Reply]) -> None:
        """Take the answers to ``@/status``."""
        now = time.monotonic()
        try:
            told = [read_health(reply.ok)[1] for reply in replies if reply.ok is not None]
            if told:
                self._on_told(told[0], now)
                return
        except ProtocolError:
            self.following.untold(now)
            raise
        self.following.untold(now)

    def _on_told(self, health: Health, now: float) -> None:
        """Take the positions that the cell confirms, and accept or refuse what waited for them."""
        refused = self.following.counts["refused"]
        self._cell = health.session
        for topic, part in self.following.told(health.session, health.positions, now):
            self._deliver(topic, [part])
        if self._stranger is not None:
            if self._stranger is not self._asked_about:
                self.following.doubt()  # it came after we had asked
            else:
                if self._stranger[1].session == self._cell:
                    self._deliver_health(*self._stranger)
                else:
                    self.following.counts["refused"] += 1
                self._stranger = None
        if (lies := self.following.counts["refused"] - refused) > 0:
            self._warn(f"refused {lies} messages that the cell does not know of: who else publishes under its name?")

    def on_standing(self, replies: list[zenoh.Reply]) -> None:
        """Take the alarms that are active now."""
        for reply in replies:
            if reply.ok is not None:
                with self._counted():
                    mark, alarm = read_message(reply.ok, ALARM)
                    assert isinstance(alarm, Alarm)
                    self._deliver(ALARM, self.following.standing(mark, alarm))

    def on_recordings(self, replies: list[zenoh.Reply]) -> None:
        """Take the answers to ``@/recordings``."""
        answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        self.following.sessions(read_sessions(answers[0]) if answers else None, time.monotonic())

    def on_answer(self, question: Question, replies: list[zenoh.Reply]) -> None:
        """Take the answers to a question about missing messages."""
        now, topic = time.monotonic(), question.topic
        problem: ProtocolError | None = None
        for reply in replies:
            try:
                if reply.ok is not None:
                    parts = read_answer(reply.ok, topic)
                    question.check(parts)
                    self._deliver(topic, self.following.filled(question, parts))
                    return
                if reply.err is not None and (reason := read_refusal(reply.err)):
                    self._deliver(topic, self.following.nothing(question, reason, now))
                    return
            except ProtocolError as error:
                problem = error
        if problem is None:
            self.following.unanswered(question, now)
            return
        self._deliver(topic, self.following.nothing(question, str(problem), now))
        raise problem

    # to the consumer --------------------------------------------------------------------------------

    def _deliver(self, topic: str, parts: list[Part]) -> None:
        for part in parts:
            message = Message(topic, part.session, part.sequence, part.backfilled, part.content)
            self.mailbox.put(message, part.size)

    def _deliver_health(self, mark: Mark, health: Health) -> None:
        self._health_reached = mark.session, mark.sequence
        if self._wants_health:
            self.mailbox.put(Message(HEALTH, mark.session, mark.sequence, False, health))

    @contextlib.contextmanager
    def _counted(self) -> Iterator[None]:
        """Count unreadable messages and go on."""
        try:
            yield
        except ProtocolError as error:
            self.counts["unreadable"] += 1
            self._warn(str(error))

    def _warn(self, text: str) -> None:
        """Log a bad message, at most once in ``_QUIET`` s: a stranger may send thousands a second."""
        now = time.monotonic()
        if now - self._warned_at > _QUIET:
            self._warned_at = now
            log.warning("%.500s", text)
