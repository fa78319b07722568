"""One connection at work: what is live goes first, then, slowly, what the broker missed."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import aiomqtt

from cellwatt.account import Account
from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.mqtt.backfill import Backfill
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.link import Link, reason
from cellwatt.outlets.mqtt.message import Message, Order
from cellwatt.outlets.mqtt.outbox import Outbox
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.sending import FENCE_EVERY, Parcel, Sending
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.selection import Row

Format = EdgeNode | PlainFormat
"""Puts a cell's data into messages, and holds the state of one connection after the other; no I/O."""
LAST_WORDS: Final = 2.0
"""Longest time, s, to send what waits when the daemon stops."""
BIRTH_EVERY: Final = 5.0
"""s between two births that others asked for: a birth is the largest message there is."""
_ANSWERS: Final = 10_000
"""Answers to what was heard that may wait."""


class HostLeftError(OutletError):
    """The primary host went offline."""


class Session:
    """Serves over one connection until it is lost. ``status`` is the newest health, to be sent when it is new."""

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
        self._sending = Sending(self._link)
        self._account = account
        self._birth_due = self._format.ready
        self._asked: asyncio.TimerHandle | None = None
        self._asked_at = -BIRTH_EVERY
        self._answers: deque[Message] = deque(maxlen=_ANSWERS)
        self._backfill: Backfill | None = None
        if record is not None:
            self._backfill = Backfill(settings, (record, cell), self._cursor, self._outbox, account)
        self.status: Mapping[str, Any] | None = None

    @property
    def problem(self) -> str | None:
        """Reason why the past cannot be sent."""
        return None if self._backfill is None else self._backfill.problem

    async def serve(self) -> None:
        """Serve until the connection is lost. Raises ``OutletError``, ``HostLeftError`` if the primary host leaves."""
        try:
            for subscription in self._format.subscriptions():
                await self._link.subscribe(subscription)
            # In a task of its own: of Python 3.11 a group leaves the task in which it failed marked as being cancelled.
            await asyncio.create_task(self._work())
        except (aiomqtt.MqttError, BaseExceptionGroup) as error:
            task = asyncio.current_task()
            if task is not None and task.cancelling():
                raise asyncio.CancelledError from None
            raise self._lost(error) from None

    async def _work(self) -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(self._listen())
            group.create_task(self._sending.confirm())
            group.create_task(self._send())
            group.create_task(self._cursor.keep())
            if self._backfill is not None:
                group.create_task(self._backfill.run())

    def _lost(self, error: BaseException) -> BaseException:
        """The reason why a session ended, as one error."""
        while isinstance(error, BaseExceptionGroup):
            error = next((e for e in error.exceptions if not isinstance(e, aiomqtt.MqttError)), error.exceptions[0])
        if isinstance(error, aiomqtt.MqttError):
            return OutletError(f"{self._settings.broker}: the connection was lost: {reason(error)}")
        return error

    async def stop(self) -> None:
        """Send what waits, as far as that goes quickly, and the last words."""
        try:
            async with asyncio.timeout(LAST_WORDS):
                await asyncio.create_task(self._finish())
        except (TimeoutError, aiomqtt.MqttError):
            self._account.count("stops without last words")

    async def _finish(self) -> None:
        confirming = asyncio.create_task(self._sending.confirm())
        try:
            while self._format.ready and await self._live(time.time_ns()):
                pass
            await self._sending.fence()
            await self._sending.send(self._format.death(time.time_ns()))
        finally:
            confirming.cancel()
            await asyncio.wait([confirming])
        await self._sending.arrive()

    async def end(self) -> None:
        """Note what arrived; take back what did not, or leave it to the record."""
        if self._asked is not None:
            self._asked.cancel()
        await self._sending.end()
        self._outbox.leave()

    # sending --------------------------------------------------------------------------------------

    async def _send(self) -> None:
        while True:
            self._outbox.wake.clear()
            while await self._live(time.time_ns()) or await self._past(time.time_ns()):
                await self._sending.fence(due=True)
            await self._sending.fence(due=True)
            try:
                async with asyncio.timeout(FENCE_EVERY if self._sending.unsure else None):
                    await self._outbox.wake.wait()
            except TimeoutError:
                continue

    async def _live(self, now: int) -> bool:
        """Send what is next of the present; false where nothing is."""
        out, sending, format_ = self._outbox, self._sending, self._format
        if self._answers:
            await sending.send([self._answers.popleft()])
        elif self._birth_due and format_.ready:
            await self._birth(now)
        elif not out.serving or not format_.ready:
            return False
        elif out.labels is not None:
            labels, out.labels = out.labels, None
            await sending.send(format_.label(labels, now))
        elif out.results:
            told = out.results.popleft()
            noted = Parcel(partial(self._account.count, "results sent"), partial(out.again, told))
            await sending.send(format_.result(told.item, told.late, now), noted)
        elif out.rows:
            entry = out.rows.popleft()
            noted = Parcel(partial(self._delivered, entry.row.time), partial(out.again, entry))
            await sending.send(format_.row(entry.row, entry.late, now), noted)
        elif out.predictions:
            seen = out.predictions.popleft()
            await sending.send(format_.predicted(seen.model, seen.units, seen.row, now))
        elif self.status is not None:
            status, self.status = self.status, None
            await sending.send(format_.health(status, now))
        else:
            return False
        return True

    async def _birth(self, now: int) -> None:
        self._birth_due = False
        if not self._outbox.serving:
            self._outbox.serving = True
            self._owe_before()
        await self._sending.send(self._format.birth(now))
        self._account.count("births")

    async def _past(self, now: int) -> bool:
        """Send the next row of the past, if there is one and it may be sent."""
        past = self._backfill.next() if self._backfill and self._outbox.serving else None
        if past is None:
            return False
        entry, format_ = past.entry, self._format
        messages = format_.row(entry, True, now) if isinstance(entry, Row) else format_.archived(entry, now)
        await self._sending.send(messages, Parcel(past.arrived))
        return True

    def _delivered(self, time_: int) -> None:
        self._account.count("rows sent")
        self._account.receive()
        self._account.owed -= 1
        self._owe_before()
        if self._backfill is not None:
            self._cursor.deliver(time_)

    def _owe_before(self) -> None:
        """What was made before this start and never arrived is owed."""
        if self._backfill is not None and self._outbox.last is not None:
            self._cursor.owe_since(self._outbox.begun)

    # listening ------------------------------------------------------------------------------------

    def _ask_birth(self) -> None:
        """Have a birth sent, at once or, where somebody asks again and again, one for all who asked meanwhile."""
        if self._birth_due or self._asked is not None:
            self._account.count("rebirths merged")
            return
        loop = asyncio.get_running_loop()
        self._asked = loop.call_at(max(loop.time(), self._asked_at + BIRTH_EVERY), self._due)

    def _due(self) -> None:
        self._asked, self._asked_at = None, asyncio.get_running_loop().time()
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
            elif not isinstance(found, Order):
                self._answers.extend(found)
            self._outbox.wake.set()
