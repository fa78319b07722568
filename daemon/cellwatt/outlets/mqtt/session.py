"""Serves one connection: births, rows and results, events, predictions and health; commands of hosts."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from cellwatt.account import Account
from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.forward import Forwarder
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.link import WINDOW, Link, LostError
from cellwatt.outlets.mqtt.message import Message, Order
from cellwatt.outlets.mqtt.outbox import Outbox
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.remote import NotNowError
from cellwatt.outlets.selection import Row
from cellwatt.outlets.together import until_one_ends
from cellwatt.results import Event, Interval

Format = EdgeNode | PlainFormat
"""Converts a cell's data into messages, and holds the state of successive connections; no I/O."""
Entry = Row | Archived
"""What is delivered at least once."""
LAST_WORDS: Final = 2.0
"""Longest time, s, to send waiting messages when the daemon stops."""
BIRTH_EVERY: Final = 5.0
"""Shortest time, s, between two requested births: a birth is the largest message."""
ANSWERS: Final = 10_000
"""Most waiting answers to received messages; further ones are dropped and counted."""


class HostLeftError(OutletError):
    """The primary host went offline."""


class Session:
    """Serves over one connection until it is lost. ``status`` is the newest health not sent yet, or ``None``.

    Messages are made at the moment when they are sent, as those of Sparkplug are numbered.
    """

    def __init__(
        self,
        settings: MqttSettings,
        link: Link,
        format_: Format,
        forwarder: Forwarder[Entry],
        outbox: Outbox,
        account: Account,
    ) -> None:
        self._settings, self._account = settings, account
        self._link, self._format, self._forwarder, self._outbox = link, format_, forwarder, outbox
        self._flight: list[Interval | Event] = []
        """Events and intervals that the broker has not confirmed."""
        self._serving = False
        """True from the first birth on."""
        self._late = 0
        """Number of the next entries that were made before this connection."""
        self._lost: LostError | None = None
        """Reason why entries could not be sent."""
        self._birth_due = self._format.ready
        self._birth_asked: asyncio.TimerHandle | None = None
        self._asked_at = -BIRTH_EVERY
        self._answers: deque[Message] = deque()
        self.status: Mapping[str, Any] | None = None

    @property
    def ready(self) -> bool:
        """True while the connection delivers what is sent."""
        return self._serving and self._format.ready

    async def serve(self) -> None:
        """Serve until the connection is lost. Raises ``OutletError``, ``HostLeftError`` if the primary host leaves."""
        for subscription in self._format.subscriptions():
            await self._link.subscribe(subscription)
        await until_one_ends(self._listen(), self._send(), self._forwarder.run())

    async def stop(self) -> None:
        """Send waiting messages, then the death or offline message, within ``LAST_WORDS``."""
        try:
            async with asyncio.timeout(LAST_WORDS):
                await self._publish(self._own())
                self._flight.clear()
                await self._publish([self._format.death(time.time_ns())])
        except (TimeoutError, LostError):
            self._account.count("stops without last words")

    def end(self) -> None:
        """Requeue what may not have arrived."""
        if self._birth_asked is not None:
            self._birth_asked.cancel()
        self._outbox.results.extendleft((item, True) for item in reversed(self._flight))

    # sending --------------------------------------------------------------------------------------

    async def send(self, entries: Sequence[Entry], *, past: bool) -> int:
        """Send entries, back-filled ones if ``past``; return the number of those refused.

        Raises ``NotNowError`` if the connection is lost; then ``serve`` ends, too.
        """
        made = self._entries(entries, len(entries) if past else self._late, past)
        try:
            refused = await self._publish(made, sure=True)
        except LostError as error:
            self._lost = error
            self._outbox.wake.set()
            raise NotNowError(str(error)) from None
        self._late -= 0 if past else min(self._late, len(entries))
        return refused

    async def _publish(self, groups: Iterable[Sequence[Message]], *, sure: bool = False) -> int:
        """Publish groups of messages, about ``WINDOW`` messages at a time.

        Return the number of groups of which the broker refused a message, once it has them; those of QoS 0 may be on
        their way, unless ``sure``. Raises ``LostError``.
        """
        refused, made = 0, iter(groups)
        while part := list(_window(made)):
            asked = [[self._link.publish(message) for message in group] for group in part]
            answers = [answer for group in asked for answer in group]
            if sure and any(message.qos == 0 for group in part for message in group):
                answers.append(self._link.fence())
            if answers:
                await self._link.arrive(answers)
            refused += sum(any(code.is_failure for answer in group for code in answer.result()) for group in asked)
        return refused

    def _entries(self, entries: Sequence[Entry], late: int, past: bool) -> Iterator[Sequence[Message]]:
        """The messages of each entry; the first ``late`` were made before this connection."""
        format_, out = self._format, self._outbox
        for number, entry in enumerate(entries):
            now, units, label = time.time_ns(), self._forwarder.picker.units, list[Message]()
            if units and units is not out.labelled:
                out.labelled = units
                label += format_.label(units, now)
            if isinstance(entry, Row):
                yield (*label, *format_.row(entry, number < late, now))
            elif past:
                yield (*label, *format_.archived(entry, now))
            else:
                yield (*label, *format_.result(entry, number < late, now))

    async def _send(self) -> None:
        """Send everything else whenever there is something to send. Raises ``LostError``."""
        while self._lost is None:
            self._outbox.wake.clear()
            while groups := list(_window(self._own())):
                await self._publish(groups)
                self._flight.clear()
            await self._outbox.wake.wait()
        raise self._lost

    def _own(self) -> Iterator[Sequence[Message]]:
        """Answers, a birth that is due, events and intervals, predictions, health."""
        out, format_ = self._outbox, self._format
        while True:
            now = time.time_ns()
            if self._answers:
                yield [self._answers.popleft()]
            elif self._birth_due and format_.ready:
                yield self._birth(now)
            elif not self.ready:
                return
            elif out.results:
                item, late = out.results.popleft()
                self._flight.append(item)
                yield format_.result(item, late, now)
            elif out.predictions:
                yield format_.predicted(*out.predictions.popleft(), now)
            elif self.status is not None:
                status, self.status = self.status, None
                yield format_.health(status, now)
            else:
                return

    def _birth(self, now: int) -> Sequence[Message]:
        self._birth_due = False
        if not self._serving:
            self._serving, waiting = True, self._forwarder.waiting
            self._late = len(waiting)
            rows = [entry for entry in waiting if isinstance(entry, Row)]
            channels = len(self._forwarder.picker.units)
            whole = next((n for n in reversed(range(len(rows))) if len(rows[n].quality) == channels), 0)
            for row in rows[whole:]:
                self._format.missed(row)
            self._forwarder.again()
        self._account.count("births")
        return self._format.birth(now)

    # listening ------------------------------------------------------------------------------------

    def _ask_birth(self) -> None:
        """Request a birth: sent at once, or after ``BIRTH_EVERY`` for all requests in that time."""
        if self._birth_due or self._birth_asked is not None:
            self._account.count("rebirths merged")
            return
        loop = asyncio.get_running_loop()
        self._birth_asked = loop.call_at(max(loop.time(), self._asked_at + BIRTH_EVERY), self._due)

    def _due(self) -> None:
        self._birth_asked, self._asked_at = None, asyncio.get_running_loop().time()
        self._birth_due = True
        self._outbox.wake.set()

    async def _listen(self) -> None:
        async for topic, payload, retained in self._link.messages():
            try:
                found = self._format.heard(topic, payload, retained)
            except ProtocolError:
                self._account.count("unreadable messages")
                continue
            if found is Order.LEAVE:
                host = self._settings.sparkplug.primary_host
                raise HostLeftError(f"{self._settings.broker}: the primary host {host} went offline")
            if found is Order.BIRTH:
                self._ask_birth()
            elif len(self._answers) >= ANSWERS and found:
                self._account.count("answers dropped", len(found))
            else:
                self._answers.extend(found)
            self._outbox.wake.set()


def _window(groups: Iterable[Sequence[Message]]) -> Iterator[Sequence[Message]]:
    """The next groups, up to about ``WINDOW`` messages."""
    size = 0
    for group in groups:
        yield group
        size += len(group)
        if size >= WINDOW:
            return
