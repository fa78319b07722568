"""The public subscriber: opens the link, requests missing messages, delivers messages and tracks the positions."""

from __future__ import annotations

import asyncio
import math
import secrets
import threading
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cellwatt.errors import ConfigError, OutletError
from cellwatt.outlets.zenoh.follow import Following
from cellwatt.outlets.zenoh.keys import ALARM, HEALTH, TOPICS, CellKeys, is_wanted
from cellwatt.outlets.zenoh.link import LinkSettings, close_session, open_beside, open_session
from cellwatt.outlets.zenoh.mark import Positions
from cellwatt.outlets.zenoh.order import Message
from cellwatt.outlets.zenoh.received import read_refusal
from cellwatt.outlets.zenoh.signing import MessageVerifier
from cellwatt.subscriber.inbox import EVERYTHING, Inbox

if TYPE_CHECKING:
    import zenoh


_TICK: Final = 0.05  # s, between two checks for missing messages
_TIMEOUT: Final = 5.0  # s, for the answer to a question
_AGAIN: Final = 1.0  # s, before another question for the active alarms, if the cell has not answered


class Subscriber:
    """A consumer of one cell.

    ``link`` is the Zenoh session to open; ``want`` are topics or prefixes of topics, like ``raw/arm``. ``resume``
    continues at the ``positions`` of an earlier run. ``patience`` is the time, s, to wait for missing messages that
    the cell should have, before they become a gap. At most ``queue_size`` messages wait for the consumer; further ones
    are discarded and requested again. ``verify`` is the public key of a cell that signs, or a certificate with it
    (PEM); messages that the cell has not signed are then discarded and counted as ``unsigned``, repeated health
    messages as ``replayed``. Raises ``ConfigError`` for topics that no cell has. Use it with ``with`` or ``async
    with``; opening raises ``OutletError`` if the link cannot be opened.

    Leave the context before the interpreter ends: an open Zenoh session prevents its exit.
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
        if unknown := [w for w in want if not is_wanted(w)]:
            raise ConfigError(f"no cell publishes {', '.join(unknown)}; topics are {TOPICS}")
        counts: Counter[str] = Counter()
        following = Following(self._want, resume or {}, patience)
        witness = MessageVerifier(self._keys.root, verify, counts)
        self._inbox = Inbox(following, witness, counts, queue_size, HEALTH in self._want)
        self._reached: dict[str, tuple[int, int]] = {}
        self._stopped = threading.Event()
        self._session: zenoh.Session | None = None
        self._standing_due = math.inf if following.joined else -math.inf
        # Not a daemon thread: Zenoh's callback threads would inherit that, and one that runs inside Zenoh while the
        # interpreter ends aborts the process.
        self._asking = threading.Thread(target=self._work, name="cellwatt subscriber", daemon=False)

    def receive(self, timeout: float | None = None) -> Message:
        """Return the next message. Raises ``TimeoutError``, or ``OutletError`` after ``close``."""
        message = self._inbox.mailbox.take(timeout)
        if message is None:
            raise OutletError("the subscriber was closed")
        return self._handed(message)

    def __iter__(self) -> Iterator[Message]:
        while (message := self._inbox.mailbox.take()) is not None:
            yield self._handed(message)

    async def __aiter__(self) -> AsyncIterator[Message]:
        while (message := await self._inbox.mailbox.take_async()) is not None:
            yield self._handed(message)

    @property
    def positions(self) -> dict[str, tuple[int, int]]:
        """Session and number of the next message to deliver, by topic; pass them as ``resume`` to continue there."""
        return {**self._inbox.following.begun, **self._reached}

    @property
    def counts(self) -> dict[str, int]:
        """Number of samples and results ``live``, ``backfilled``, ``lost`` and ``duplicates``, and of bad messages.

        ``unreadable`` messages are not valid messages of a cell; ``let go`` ones were discarded because the queue was
        full or their schema was missing, and are requested again.
        """
        following = self._inbox.following
        return {**(following.counts + self._inbox.counts), "duplicates": following.duplicates}

    def _handed(self, message: Message) -> Message:
        if message.topic != HEALTH:
            session, end = self._reached.get(message.topic) or self._inbox.following.begun[message.topic]
            if message.session != session or message.sequence >= end:
                self._reached[message.topic] = (message.session, message.sequence + message.count)
        return message

    def open(self) -> None:
        """Open the session and subscribe; blocks. Raises ``OutletError``."""
        self._begin(open_session(self._link))

    def _begin(self, session: zenoh.Session) -> None:
        self._session = session
        for wanted in dict.fromkeys((*self._want, HEALTH)):
            session.declare_subscriber(self._keys.live(f"{wanted}/**"), self._inbox.on_sample)
        self._inbox.look.set()
        self._asking.start()

    def close(self) -> None:
        """Close the session; consumers waiting for messages return."""
        self._stopped.set()
        self._inbox.look.set()
        self._inbox.mailbox.end()
        if self._session is not None:
            close_session(self._session)
        if self._asking.is_alive():
            self._asking.join()

    def _work(self) -> None:
        """Request missing messages from the cell, until ``close``."""
        import pyarrow  # noqa: F401  # so that the first message does not wait for it
        import zenoh

        inbox = self._inbox
        try:
            while not self._stopped.is_set():
                inbox.look.wait(_TICK)
                inbox.look.clear()
                if not inbox.mailbox.full:
                    self._ask_what_is_missing()
        except zenoh.ZError as error:
            inbox.mailbox.end(OutletError(f"Zenoh session: {error}"))
        except BaseException as error:
            inbox.mailbox.end(error)
            raise

    def _ask_what_is_missing(self) -> None:
        inbox, now = self._inbox, time.monotonic()
        with inbox.lock:
            following = inbox.following
            telling = following.asks_told(now)
            questions = following.questions(now)
            if standing := following.joined and now >= self._standing_due and following.wants(ALARM):
                self._standing_due = math.inf
            sessions = following.asks_sessions(now)
        if telling:
            self._ask(self._keys.question("status"), "@/status", inbox.on_status)
        if sessions:
            self._ask(self._keys.question("recordings"), "@/recordings", inbox.on_recordings)
        if standing:
            self._ask(f"{self._keys.live(f'{ALARM}/**')}?none=1", ALARM, self._on_standing)
        for question in questions:
            self._ask(question.selector(self._keys), question.topic, partial(inbox.on_answer, question))

    def _on_standing(self, replies: list[zenoh.Reply]) -> None:
        """Pass the active alarms to the consumer; ask again if the cell answered neither with them nor that none is."""
        if all(reply.ok is None and (reply.err is None or read_refusal(reply.err) is None) for reply in replies):
            self._standing_due = time.monotonic() + _AGAIN
        self._inbox.on_standing(replies)

    def _ask(self, selector: str, topic: str, then: Callable[[list[zenoh.Reply]], None]) -> None:
        """Ask about a topic; call ``then`` with the replies once all have arrived."""
        import zenoh

        replies: list[zenoh.Reply] = []
        witness = self._inbox.witness
        if witness.asks_for_proof:  # so that an older answer is not accepted as this one
            selector += f"{';' if '?' in selector else '?'}nonce={secrets.token_hex(8)}"

        def done() -> None:
            with self._inbox.guarded():
                then([reply for reply in replies if witness.reply(topic, selector, reply)])
            self._inbox.look.set()

        assert self._session is not None
        self._session.get(
            selector,
            zenoh.handlers.Callback(replies.append, done),
            timeout=_TIMEOUT,
            consolidation=zenoh.ConsolidationMode.NONE,
            priority=zenoh.Priority.DATA_LOW,
        )

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
        try:
            self._begin(await open_beside(self._link))
        except BaseException:
            await asyncio.to_thread(self.close)
            raise
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.close)
