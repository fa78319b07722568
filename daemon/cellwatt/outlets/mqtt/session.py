"""Serves one connection: live messages first, then the back-fill at a limited rate."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

from cellwatt.account import Account
from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.link import WINDOW, Answer, Link, LostError
from cellwatt.outlets.mqtt.message import Message, Order
from cellwatt.outlets.mqtt.outbox import Backfill, Outbox
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.together import until_one_ends

Format = EdgeNode | PlainFormat
"""Converts a cell's data into messages, and holds the state of successive connections; no I/O."""
LAST_WORDS: Final = 2.0
"""Longest time, s, to send waiting messages when the daemon stops."""
BIRTH_EVERY: Final = 5.0
"""Shortest time, s, between two requested births: a birth is the largest message."""
ANSWERS: Final = 10_000
"""Most waiting answers to received messages; further ones are dropped and counted."""


class HostLeftError(OutletError):
    """The primary host went offline."""


@dataclass(frozen=True, slots=True)
class Parcel:
    """Messages, with a function to call once they have arrived, and one to requeue them if they may not have.

    ``arrived`` receives True if the broker refused a message.
    """

    messages: Sequence[Message]
    arrived: Callable[[bool], None] | None = None
    back: Callable[[], None] | None = None


class Session:
    """Serves over one connection until it is lost. ``status`` is the newest health not sent yet, or ``None``."""

    def __init__(
        self,
        settings: MqttSettings,
        parts: tuple[Link, Format, Outbox, Cursor],
        record: Path | None,
        cell: str,
        account: Account,
    ) -> None:
        self._settings = settings
        self._link, self._format, self._outbox, self._cursor = parts
        self._account = account
        self._batch: Sequence[Parcel] = ()
        """Parcels in flight."""
        self._asked: list[Answer] = []
        """Answers to the messages of ``_batch``, and to a fence if the broker does not confirm all of them."""
        self._birth_due = self._format.ready
        self._birth_asked: asyncio.TimerHandle | None = None
        self._asked_at = -BIRTH_EVERY
        self._answers: deque[Message] = deque()
        self._backfill: Backfill | None = None
        if record is not None:
            self._backfill = Backfill(settings, (record, cell), self._cursor, self._outbox, account)
        self.status: Mapping[str, Any] | None = None

    @property
    def problem(self) -> str | None:
        """Reason why the back-fill fails, or ``None``."""
        return None if self._backfill is None else self._backfill.problem

    async def serve(self) -> None:
        """Serve until the connection is lost. Raises ``OutletError``, ``HostLeftError`` if the primary host leaves."""
        for subscription in self._format.subscriptions():
            await self._link.subscribe(subscription)
        past = () if self._backfill is None else (self._backfill.run(),)
        await until_one_ends(self._listen(), self._send(), self._cursor.keep(), *past)

    async def stop(self) -> None:
        """Send waiting messages, then the death or offline message, within ``LAST_WORDS``."""
        try:
            async with asyncio.timeout(LAST_WORDS):
                await self._arrive()
                while self._format.ready and (batch := self._next()):
                    await self._deliver(batch)
                await self._deliver([Parcel(self._format.death(time.time_ns()))])
        except (TimeoutError, LostError):
            self._account.count("stops without last words")

    def end(self) -> None:
        """Count what arrived; requeue or owe what did not."""
        if self._birth_asked is not None:
            self._birth_asked.cancel()
        self._note()
        self._outbox.leave()

    # sending --------------------------------------------------------------------------------------

    async def _send(self) -> None:
        while True:
            self._outbox.wake.clear()
            while batch := self._next():
                await self._deliver(batch)
            await self._outbox.wake.wait()

    async def _deliver(self, batch: Sequence[Parcel]) -> None:
        """Send parcels; return once the broker has them. Raises ``LostError``."""
        self._batch = batch
        self._asked = [self._link.publish(message) for parcel in batch for message in parcel.messages]
        if any(message.qos == 0 for parcel in batch if parcel.arrived for message in parcel.messages):
            self._asked.append(self._link.fence())
        await self._arrive()

    async def _arrive(self) -> None:
        """Wait until the parcels in flight arrive; after a cancellation they stay in flight. Raises ``LostError``."""
        if self._asked:
            await self._link.arrive(self._asked)
        self._note()

    def _note(self) -> None:
        """Count the parcels that arrived, in order; requeue the others."""
        fenced, at, unconfirmed = all(map(_came, self._asked)), 0, list[Parcel]()
        for parcel in self._batch:
            answers, at = self._asked[at : at + len(parcel.messages)], at + len(parcel.messages)
            sure = fenced or all(message.qos for message in parcel.messages)
            asked = len(answers) == len(parcel.messages)  # false if the library refused a message of the batch
            if unconfirmed or not sure or not asked or not all(map(_came, answers)):
                unconfirmed.append(parcel)
            elif parcel.arrived is not None:
                parcel.arrived(any(code.is_failure for answer in answers for code in answer.result()))
        for parcel in reversed(unconfirmed):
            if parcel.back is not None:
                parcel.back()
        self._batch, self._asked = (), []

    def _next(self) -> list[Parcel]:
        """The next parcels: live ones, then back-fill, up to about ``WINDOW`` messages."""
        found, size, now = list[Parcel](), 0, time.time_ns()
        while size < WINDOW and (parcel := self._live(now) or self._past(now)) is not None:
            found.append(parcel)
            size += len(parcel.messages)
        return found

    def _live(self, now: int) -> Parcel | None:
        """The next live parcel."""
        out, format_ = self._outbox, self._format
        if self._answers:
            return Parcel([self._answers.popleft()])
        if self._birth_due and format_.ready:
            return self._birth(now)
        if not out.serving or not format_.ready:
            return None
        if out.units is not None:
            units, out.units = out.units, None
            return Parcel(format_.label(units, now))
        if out.results:
            result = out.results.popleft()
            messages = format_.result(result.item, result.late, now)
            return Parcel(
                messages,
                lambda refused: self._account.count("results refused" if refused else "results sent"),
                partial(out.again, result),
            )
        if out.rows:
            row = out.rows.popleft()
            messages = format_.row(row.item, row.late, now)
            return Parcel(messages, partial(self._delivered, row.item.time), partial(out.again, row))
        if out.predictions:
            return Parcel(format_.predicted(*out.predictions.popleft(), now))
        if self.status is not None:
            status, self.status = self.status, None
            return Parcel(format_.health(status, now))
        return None

    def _birth(self, now: int) -> Parcel:
        self._birth_due = False
        if not self._outbox.serving:
            self._outbox.serving = True
            self._owe_before()
            if self._backfill is not None and self._outbox.last is not None:
                self._cursor.deliver(self._outbox.last)  # all earlier rows are owed from the record
        self._account.count("births")
        return Parcel(self._format.birth(now))

    def _past(self, now: int) -> Parcel | None:
        """The next parcel of back-fill, if there is one and it may be sent."""
        past = self._backfill
        if past is None or past.piece is None or not self._outbox.serving:
            return None
        (results, rows, arrived), past.piece = past.piece, None
        messages = [message for result in results for message in self._format.archived(result, now)]
        messages += [message for row in rows for message in self._format.row(row, True, now)]
        return Parcel(messages, arrived)

    def _delivered(self, time_: int, refused: bool) -> None:
        self._account.count("rows refused" if refused else "rows sent")
        self._account.miss(refused, "refused")
        self._account.receive(not refused)
        self._account.owed -= 1
        self._owe_before()
        if self._backfill is not None:
            self._cursor.deliver(time_)

    def _owe_before(self) -> None:
        """Owe everything made before this start that never arrived."""
        if self._backfill is not None and self._outbox.last is not None:
            self._cursor.owe_since(self._outbox.begun)

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


def _came(answer: Answer) -> bool:
    return answer.done() and not answer.cancelled()
