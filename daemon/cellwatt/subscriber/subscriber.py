"""The public subscriber: opens the link, hands out messages, and keeps the consumer's positions."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections import Counter
from collections.abc import AsyncIterator, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cellwatt.errors import ConfigError, OutletError
from cellwatt.outlets.zenoh.follow import Following, Positions
from cellwatt.outlets.zenoh.keys import HEALTH, KINDS, CellKeys
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.signing import Witness
from cellwatt.subscriber.asking import Asker
from cellwatt.subscriber.inbox import Inbox
from cellwatt.subscriber.message import EVERYTHING, Message

if TYPE_CHECKING:
    import zenoh


class Subscriber:
    """A consumer of one cell.

    ``link`` is the Zenoh session to open; ``want`` are topics or first parts of topics, like ``raw/arm``. ``resume``
    continues at the ``positions`` of an earlier run. ``patience`` is the time in s to wait for missing messages that
    the cell should have, before they become a gap. ``queue_size`` messages may wait for the consumer; further ones
    are let go and asked for again. ``verify`` is the public key of a cell that signs, or a certificate with it (PEM);
    messages that the cell has not signed are then left out and counted as ``unsigned``, repeated health messages as
    ``replayed``. Raises ``ConfigError`` for topics that no cell has. Use it with ``with`` or ``async with``; opening
    raises ``OutletError`` if the link cannot be opened.

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
        counts: Counter[str] = Counter()
        following = Following(self._want, resume or {}, patience)
        witness = Witness(self._keys.root, verify, counts)
        self._inbox = Inbox(following, witness, counts, queue_size, HEALTH in self._want)
        self._reached: dict[str, tuple[int, int]] = {}
        self._stopped = threading.Event()
        self._session: zenoh.Session | None = None
        self._asker: Asker | None = None

    def receive(self, timeout: float | None = None) -> Message:
        """Take the next message. Raises ``TimeoutError``, or ``OutletError`` after ``close``."""
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
        """Session and number of the next message to hand out, by topic; ``resume`` of another run continues there."""
        return {**self._inbox.following.begun, **self._reached}

    @property
    def counts(self) -> dict[str, int]:
        """Number of samples and results ``live``, ``backfilled``, ``lost`` and ``duplicates``, and of bad messages.

        ``unreadable`` messages were not a cell's, ``refused`` ones claimed something that the cell did not confirm,
        and ``let go`` ones found no room; true messages among these are asked for again.
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
        import pyarrow  # noqa: F401  # so that the first message does not wait for it

        self._session = open_session(self._link, self._stopped.is_set)
        for wanted in dict.fromkeys((*self._want, HEALTH)):
            self._session.declare_subscriber(self._keys.live(f"{wanted}/**"), self._inbox.on_sample)
        self._asker = Asker(self._session, self._keys, self._inbox)
        self._asker.start()

    def close(self) -> None:
        """Close the session; consumers that wait for messages return."""
        import zenoh

        self._stopped.set()
        self._inbox.mailbox.end()
        if self._session is not None:
            with contextlib.suppress(zenoh.ZError):  # closed already
                self._session.close()  # type: ignore[no-untyped-call]
        if self._asker is not None:
            self._asker.stop()

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
                opening.exception()  # the task that waited for it is gone
            await asyncio.to_thread(self.close)
            raise

    async def __aexit__(self, *_: object) -> None:
        await asyncio.to_thread(self.close)
