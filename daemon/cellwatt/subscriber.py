"""Takes the data of one cell from the bus: each topic in order, each sample exactly once.

    async with Subscriber("plant-1", "weld-3", LinkSettings(mode="client", connect=("tcp/router:7447",))) as cell:
        async for message in cell:
            print(message.topic, message.sequence, message.content)

Holes, which a cut of the link leaves, are filled from the cell's record before what came after them is delivered;
such messages have ``backfilled`` set. What the cell no longer has is delivered as a ``Gap``.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import secrets
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cellwatt.batch import Batch
from cellwatt.errors import ConfigError, ProtocolError, SinkError
from cellwatt.frames import Frames
from cellwatt.publish.asking import Question
from cellwatt.publish.follow import Following, Positions
from cellwatt.publish.keys import ALARM, HEALTH, KINDS, CellKeys, parse
from cellwatt.publish.link import LinkSettings, open_session
from cellwatt.publish.mailbox import Mailbox
from cellwatt.publish.mark import Mark
from cellwatt.publish.order import Gap, Part
from cellwatt.publish.received import (
    Health,
    read_answer,
    read_health,
    read_message,
    read_refusal,
    read_sessions,
)
from cellwatt.publish.witness import Witness
from cellwatt.results import Alarm, Event, Result

if TYPE_CHECKING:
    import zenoh

__all__ = ["EVERYTHING", "Gap", "Health", "LinkSettings", "Message", "Subscriber"]

log = logging.getLogger(__name__)

EVERYTHING: Final = ("raw", "frame", "interval", "task", "energy", "prediction", "alarm", "event", "health")
"""All topics of a cell."""
_TICK: Final = 0.05  # s, between two looks at what is missing
_TIMEOUT: Final = 5.0  # s, for the answer to one question
_QUEUE_BYTES: Final = 256 * 1024 * 1024  # of messages that wait for the consumer
_QUIET: Final = 10.0  # s, between two lines in the log about what others put on the bus


@dataclass(frozen=True, slots=True)
class Message:
    """Something from the cell, in its place.

    ``sequence`` is the number of the first sample (raw, frame) or of the result within ``topic`` and ``session``.
    ``backfilled`` where it was asked for later, because it was missed or happened before the subscription began.
    """

    topic: str
    session: int
    sequence: int
    backfilled: bool
    content: Batch | Frames | Result | Event | Health | Gap

    @property
    def count(self) -> int:
        """Samples in it; 1 for a result."""
        content = self.content
        if isinstance(content, Gap):
            return content.count
        return len(content) if isinstance(content, Batch | Frames) else 1


class Subscriber:
    """A consumer of one cell.

    ``link`` is the Zenoh session to make; ``want`` topics or first parts of topics, like ``raw/arm``. ``resume`` takes
    up where an earlier run's ``positions`` were. ``patience``: time, s, to wait for what the cell should have before
    it is called a gap. ``queue_size``: messages that may wait for the consumer; beyond that they are let go, and asked
    for again. ``verify``: public key of a cell that signs, or a certificate with it (PEM); what the cell has not
    signed is then left out and counted as ``unsigned``, health that is shown again as ``replayed``. Raises
    ``ConfigError`` for topics that no cell has. Use it with ``with`` or ``async with``; opening raises ``SinkError``
    when the link cannot be made.

    Leave the context before the interpreter ends: an open Zenoh session keeps it from exiting.
    """

    def __init__(
        self,
        site: str,
        cell: str,
        link: LinkSettings,
        *,
        want: Sequence[str] = EVERYTHING,
        resume: Positions | None = None,
        patience: float = 5.0,
        queue_size: int = 10_000,
        verify: Path | None = None,
    ) -> None:
        self._keys = CellKeys(site, cell)
        self._link = link
        self._want = tuple(want)
        if unknown := [w for w in want if w.split("/", 1)[0] not in KINDS]:
            raise ConfigError(f"no cell publishes {', '.join(unknown)}; topics begin with {', '.join(KINDS)}")
        self._following = Following(self._want, resume or {}, patience)
        self._standing_asked = self._following.joined
        self._mailbox: Mailbox[Message] = Mailbox(queue_size, _QUEUE_BYTES)
        self._lock = threading.Lock()
        self._look = threading.Event()
        self._counts: Counter[str] = Counter()
        self._witness = Witness(self._keys.root, verify, self._counts)
        self._health_reached = (0, 0)
        self._cell: int | None = None  # session of the daemon, as it said itself
        self._stranger: tuple[Mark, Health] | None = None  # health of a session that the cell has not told of
        self._asked_about: tuple[Mark, Health] | None = None
        self._warned_at = -math.inf
        self._reached: dict[str, tuple[int, int]] = {}
        self._stopped = threading.Event()
        self._session: zenoh.Session | None = None
        self._thread: threading.Thread | None = None

    # for consumers ----------------------------------------------------------------------------------

    def receive(self, timeout: float | None = None) -> Message:
        """The next message. Raises ``TimeoutError``, or ``SinkError`` after ``close``."""
        message = self._mailbox.take(timeout)
        if message is None:
            raise SinkError("the subscriber was closed")
        return self._handed(message)

    def __iter__(self) -> Iterator[Message]:
        while (message := self._mailbox.take()) is not None:
            yield self._handed(message)

    async def __aiter__(self) -> AsyncIterator[Message]:
        while (message := await self._mailbox.take_async()) is not None:
            yield self._handed(message)

    @property
    def positions(self) -> dict[str, tuple[int, int]]:
        """By topic, session and next number after what was handed out: ``resume`` of another run goes on from there."""
        return {**self._following.begun, **self._reached}

    @property
    def counts(self) -> dict[str, int]:
        """Samples and results ``live``, ``backfilled``, ``lost`` and ``duplicates``, and messages that were odd.

        Of these, ``unreadable`` were no messages of a cell, ``refused`` ones claimed what the cell did not confirm,
        and ``let go`` ones found no room; what was true of the last is asked for again.
        """
        return {**(self._following.counts + self._counts), "duplicates": self._following.duplicates}

    def _handed(self, message: Message) -> Message:
        if message.topic != HEALTH:
            session, end = self._reached.get(message.topic) or self._following.begun[message.topic]
            if message.session != session or message.sequence >= end:
                self._reached[message.topic] = (message.session, message.sequence + message.count)
        return message

    # life -------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Make the session and subscribe; blocks."""
        import pyarrow  # noqa: F401  # so that the first message does not wait for it

        self._session = open_session(self._link, self._stopped.is_set)
        # No daemon thread: the threads in which Zenoh calls back inherit that, and one of them inside Zenoh
        # while the interpreter ends aborts the process.
        self._thread = threading.Thread(target=self._work, name="cellwatt subscriber", daemon=False)
        for wanted in dict.fromkeys((*self._want, HEALTH)):
            self._session.declare_subscriber(self._keys.live(f"{wanted}/**"), self._on_sample)
        self._look.set()
        self._thread.start()

    def close(self) -> None:
        """End the session and whoever waits for messages."""
        import zenoh

        self._stopped.set()
        self._mailbox.end()
        if self._session is not None:
            with contextlib.suppress(zenoh.ZError):  # closed already
                self._session.close()  # type: ignore[no-untyped-call]
        if self._thread is not None and self._thread.is_alive():
            self._look.set()
            self._thread.join()

    def __enter__(self) -> Subscriber:
        try:
            self.open()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> Subscriber:
        opening = asyncio.ensure_future(asyncio.to_thread(self.__enter__))
        try:
            return await asyncio.shield(opening)
        except asyncio.CancelledError:
            self._stopped.set()
            await asyncio.wait([opening])
            if not opening.cancelled():
                opening.exception()  # whoever waited for what it says is gone
            await asyncio.to_thread(self.close)
            raise

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.close)

    # Zenoh's threads: as quick as decoding is, no calls to Zenoh -------------------------------------

    def _on_sample(self, sample: zenoh.Sample) -> None:
        with self._guarded():
            if self._mailbox.full:
                self._counts["let go"] += 1
                return
            address = parse(str(sample.key_expr))
            if not self._witness.message(address.topic, sample):
                return
            if address.kind == HEALTH:
                mark, health = read_health(sample)
                if self._witness.newer(mark, self._health_reached):
                    self._on_health(mark, health)
                return
            mark, content = read_message(sample, address.kind)
            size = len(sample.payload)
            ready = self._following.message(address.topic, mark, content, size)
            self._deliver(address.topic, ready)
            if not ready:
                self._look.set()

    def _on_health(self, mark: Mark, health: Health) -> None:
        self._following.hinted(health.positions)
        if self._cell in (None, health.session):
            self._deliver_health(mark, health)
        else:
            self._stranger = mark, health
            self._following.doubt()
        self._look.set()

    def _deliver_health(self, mark: Mark, health: Health) -> None:
        self._health_reached = mark.session, mark.sequence
        if HEALTH in self._want:
            self._mailbox.put(Message(HEALTH, mark.session, mark.sequence, False, health))

    def _on_status(self, replies: list[zenoh.Reply]) -> None:
        now = time.monotonic()
        try:
            told = [read_health(reply.ok)[1] for reply in replies if reply.ok is not None]
            if told:
                self._on_told(told[0], now)
                return
        except ProtocolError:
            self._following.untold(now)
            raise
        self._following.untold(now)

    def _on_told(self, health: Health, now: float) -> None:
        """The cell itself says where it is."""
        refused = self._following.counts["refused"]
        self._cell = health.session
        for topic, part in self._following.told(health.session, health.positions, now):
            self._deliver(topic, [part])
        if self._stranger is not None:
            if self._stranger is not self._asked_about:
                self._following.doubt()  # it came after we had asked
            else:
                if self._stranger[1].session == self._cell:
                    self._deliver_health(*self._stranger)
                else:
                    self._following.counts["refused"] += 1
                self._stranger = None
        if (lies := self._following.counts["refused"] - refused) > 0:
            self._warn(f"{lies} messages claim what the cell does not know of and are refused: who speaks in its name?")

    def _on_standing(self, replies: list[zenoh.Reply]) -> None:
        for reply in replies:
            if reply.ok is not None:
                with self._counted():
                    mark, alarm = read_message(reply.ok, ALARM)
                    assert isinstance(alarm, Alarm)
                    self._deliver(ALARM, self._following.standing(mark, alarm))

    def _on_recordings(self, replies: list[zenoh.Reply]) -> None:
        answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        self._following.sessions(read_sessions(answers[0]) if answers else None, time.monotonic())

    def _on_answer(self, question: Question, replies: list[zenoh.Reply]) -> None:
        now, topic = time.monotonic(), question.topic
        problem: ProtocolError | None = None
        for reply in replies:
            try:
                if reply.ok is not None:
                    parts = read_answer(reply.ok, topic)
                    question.check(parts)
                    self._deliver(topic, self._following.filled(question, parts))
                    return
                if reply.err is not None and (reason := read_refusal(reply.err)):
                    self._deliver(topic, self._following.nothing(question, reason, now))
                    return
            except ProtocolError as error:
                problem = error
        if problem is None:
            self._following.unanswered(question, now)
            return
        self._deliver(topic, self._following.nothing(question, str(problem), now))
        raise problem

    def _deliver(self, topic: str, parts: list[Part]) -> None:
        for part in parts:
            message = Message(topic, part.session, part.sequence, part.backfilled, part.content)
            self._mailbox.put(message, part.size)

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """One thread at a time; Zenoh would swallow what is raised here, so it goes to the consumer."""
        with self._lock:
            try:
                with self._counted():
                    yield
            except Exception as error:
                self._mailbox.end(error)

    @contextlib.contextmanager
    def _counted(self) -> Iterator[None]:
        """What cannot be read is counted, and ends nothing."""
        try:
            yield
        except ProtocolError as error:
            self._counts["unreadable"] += 1
            self._warn(str(error))

    def _warn(self, text: str) -> None:
        """Say in the log what others put on the bus, not each time: they may do so thousands of times a second."""
        now = time.monotonic()
        if now - self._warned_at > _QUIET:
            self._warned_at = now
            log.warning("%.500s", text)

    # our thread: asks -------------------------------------------------------------------------------

    def _work(self) -> None:
        import zenoh

        try:
            while not self._stopped.is_set():
                self._look.wait(_TICK)
                self._look.clear()
                if not self._mailbox.full:
                    self._ask_what_is_missing()
        except zenoh.ZError as error:
            self._mailbox.end(SinkError(f"Zenoh session: {error}"))
        except BaseException as error:
            self._mailbox.end(error)
            raise

    def _ask_what_is_missing(self) -> None:
        with self._lock:
            if telling := self._following.asks_told(time.monotonic()):
                self._asked_about = self._stranger
            questions = self._following.questions(time.monotonic())
            standing = self._following.joined and not self._standing_asked and self._following.wants(ALARM)
            self._standing_asked |= standing
            sessions = self._following.asks_sessions(time.monotonic())
        if telling:
            self._ask(self._keys.question("status"), "@/status", self._on_status)
        if sessions:
            self._ask(self._keys.question("recordings"), "@/recordings", self._on_recordings)
        if standing:
            self._ask(self._keys.live(f"{ALARM}/**"), ALARM, self._on_standing)
        for question in questions:
            self._ask(question.selector(self._keys), question.topic, partial(self._on_answer, question))

    def _ask(self, selector: str, topic: str, then: Callable[[list[zenoh.Reply]], None]) -> None:
        """Ask about a topic; ``then`` gets the replies once all are there."""
        import zenoh

        assert self._session is not None
        replies: list[zenoh.Reply] = []
        if self._witness.asks_for_proof:  # so that no answer of another time can stand for this one
            selector += f"{';' if '?' in selector else '?'}nonce={secrets.token_hex(8)}"

        def done() -> None:
            with self._guarded():
                then([reply for reply in replies if self._witness.reply(topic, selector, reply)])
            self._look.set()

        self._session.get(
            selector,
            zenoh.handlers.Callback(replies.append, done),
            timeout=_TIMEOUT,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=zenoh.Priority.DATA_LOW,
        )
