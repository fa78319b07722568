"""Puts the live messages and answers of one cell in order for the consumer.

Zenoh calls back in its own threads. One of them at a time runs this code; it only decodes, and never calls Zenoh.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import threading
import time
import zlib
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import Future, InvalidStateError
from typing import TYPE_CHECKING, Final

from cellwatt.batch import Batch
from cellwatt.errors import ProtocolError
from cellwatt.frames import Frames
from cellwatt.outlets.zenoh.encode import schema_in
from cellwatt.outlets.zenoh.follow import Following
from cellwatt.outlets.zenoh.keys import ALARM, HEALTH, KINDS, Address, parse
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.order import Message
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
from cellwatt.outlets.zenoh.signing import MessageVerifier
from cellwatt.results import Alarm

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger("cellwatt.subscriber")

EVERYTHING: Final = KINDS
"""All topics of a cell."""
_MOST: Final = 1000
"""Most topics whose last schema is stored."""
_QUEUE_BYTES: Final = 256 * 1024 * 1024  # of messages that wait for the consumer
_QUIET: Final = 10.0  # s, least time between two log lines about bad messages


class Mailbox:
    """A FIFO queue from threads to other threads and event loops; ``take`` waits while it is empty.

    ``put`` never waits: callers check ``full`` first, which is true from ``limit`` items or 256 MB on.
    After ``end`` nothing can be put; takers receive the remaining items, then ``None`` or the error given to ``end``.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._items: deque[Message] = deque()
        self._bytes = 0
        self._waiters: list[Future[None]] = []
        self._lock = threading.Lock()
        self._ended = False
        self._error: BaseException | None = None

    @property
    def full(self) -> bool:
        """True at or beyond the limit of items or bytes."""
        return len(self._items) >= self._limit or self._bytes >= _QUEUE_BYTES

    def put(self, item: Message) -> None:
        """Add an item; discard it if the mailbox was ended."""
        with self._lock:
            if self._ended:
                return
            self._items.append(item)
            self._bytes += item.size
        self._wake()

    def end(self, error: BaseException | None = None) -> None:
        """End the mailbox; the error of the first call applies."""
        with self._lock:
            if not self._ended:
                self._ended, self._error = True, error
        self._wake()

    def take(self, timeout: float | None = None) -> Message | None:
        """Take the next item. Raises ``TimeoutError`` if none arrives within ``timeout`` s."""
        end = math.inf if timeout is None else time.monotonic() + timeout
        while isinstance(found := self._next(), Future):
            try:
                found.result(None if timeout is None else max(end - time.monotonic(), 0.0))
            except TimeoutError:
                raise TimeoutError(f"no message within {timeout} s") from None
            finally:
                found.cancel()
        return found

    async def take_async(self) -> Message | None:
        """Take the next item on an event loop, without a time-out."""
        while isinstance(found := self._next(), Future):
            await asyncio.wrap_future(found)
        return found

    def _next(self) -> Message | Future[None] | None:
        """The next item; ``None`` at the end; or a future that completes once there may be an item."""
        with self._lock:
            if self._items:
                item = self._items.popleft()
                self._bytes -= item.size
                return item
            if self._error is not None:
                raise self._error
            if self._ended:
                return None
            waiter: Future[None] = Future()
            self._waiters = [*(w for w in self._waiters if not w.done()), waiter]
            return waiter

    def _wake(self) -> None:
        if self._waiters:
            with self._lock:
                waiters, self._waiters = self._waiters, []
            for waiter in waiters:
                with contextlib.suppress(InvalidStateError):  # the waiter was cancelled
                    waiter.set_result(None)


class Inbox:
    """Puts messages that ``witness`` accepts into ``mailbox`` in order, and sets ``look`` if some may be missing.

    Use ``following`` under ``lock``. At most ``queue_size`` messages wait; beyond that, live ones are discarded.
    Health is delivered if ``health`` is set.
    """

    def __init__(
        self, following: Following, witness: MessageVerifier, counts: Counter[str], queue_size: int, health: bool
    ) -> None:
        self.following = following
        self.witness = witness
        self.counts = counts
        self._schemas: dict[str, dict[int, bytes]] = {}
        """The last schema of each topic, by its CRC-32."""
        self.mailbox = Mailbox(queue_size)
        self.lock = threading.Lock()
        self.look = threading.Event()
        self._wants_health = health
        self._health_reached = (0, 0)
        self._warned_at = -math.inf

    @contextlib.contextmanager
    def guarded(self) -> Iterator[None]:
        """Admit one thread at a time, and pass errors to the consumer, because Zenoh would discard them."""
        with self.lock:
            try:
                with self._counted():
                    yield
            except Exception as error:
                self.mailbox.end(error)

    # live messages ----------------------------------------------------------------------------------

    def on_sample(self, sample: zenoh.Sample) -> None:
        """Process a live message."""
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
            mark, content = read_message(sample, address.kind, self._schemas.get(topic, {}))
        except UnknownSchemaError:  # the schema is in transit; then this message is requested again
            self.counts["let go"] += 1
            return
        room = topic in self._schemas or len(self._schemas) < _MOST
        if isinstance(content, Batch | Frames) and not mark.schema and room:
            schema = schema_in(sample.payload.to_bytes())
            self._schemas[topic] = {zlib.crc32(schema): schema}
        ready = self.following.message(topic, mark, content, len(sample.payload))
        self._deliver(ready)
        if not ready:
            self.look.set()

    def _on_health(self, mark: Mark, health: Health) -> None:
        self.following.hinted(health.session, health.positions)
        if self.following.cell in (None, health.session):  # else after the cell has confirmed its new session
            self._health_reached = mark.session, mark.sequence
            if self._wants_health:
                self.mailbox.put(Message(HEALTH, mark.session, mark.sequence, False, health))
        self.look.set()

    # answers, under ``guarded`` ---------------------------------------------------------------------

    def on_status(self, replies: list[zenoh.Reply]) -> None:
        """Process the answers to ``@/status``."""
        now = time.monotonic()
        status: Health | None = None
        for reply in replies:
            if reply.ok is not None and status is None:
                with self._counted():
                    status = read_health(reply.ok)[1]
        if status is None:
            self.following.untold(now)
            return
        self._deliver(self.following.told(status.session, status.positions, now))

    def on_standing(self, replies: list[zenoh.Reply]) -> None:
        """Process the active alarms."""
        for reply in replies:
            if reply.ok is not None:
                with self._counted():
                    mark, alarm = read_message(reply.ok, ALARM)
                    assert isinstance(alarm, Alarm)
                    self._deliver(self.following.standing(mark, alarm))

    def on_recordings(self, replies: list[zenoh.Reply]) -> None:
        """Process the answers to ``@/recordings``."""
        answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        self.following.sessions(read_sessions(answers[0]) if answers else None, time.monotonic())

    def on_answer(self, question: Question, replies: list[zenoh.Reply]) -> None:
        """Process the answers to a question about missing messages."""
        now = time.monotonic()
        problem: ProtocolError | None = None
        for reply in replies:
            try:
                if reply.ok is not None:
                    parts = read_answer(reply.ok, question.topic)
                    question.check(parts)
                    self._deliver(self.following.filled(question, parts))
                    return
                if reply.err is not None and (reason := read_refusal(reply.err)):
                    self._deliver(self.following.nothing(question, reason, now))
                    return
            except ProtocolError as error:
                problem = error
        if problem is None:
            self.following.unanswered(question, now)
            return
        self._deliver(self.following.nothing(question, str(problem), now))
        raise problem

    # to the consumer --------------------------------------------------------------------------------

    def _deliver(self, messages: list[Message]) -> None:
        for message in messages:
            self.mailbox.put(message)

    @contextlib.contextmanager
    def _counted(self) -> Iterator[None]:
        """Count unreadable messages and continue."""
        try:
            yield
        except ProtocolError as error:
            self.counts["unreadable"] += 1
            self._warn(str(error))

    def _warn(self, text: str) -> None:
        """Log a bad message, at most once in ``_QUIET`` s: a stranger may send thousands per second."""
        now = time.monotonic()
        if now - self._warned_at > _QUIET:
            self._warned_at = now
            log.warning("%.500s", text)
