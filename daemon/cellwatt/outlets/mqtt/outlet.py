"""The MQTT outlet: JSON topics for any consumer, or Sparkplug B for SCADA hosts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from typing import Any, ClassVar

from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.forward import cursor_of, framed_record
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.link import Link, tls_context
from cellwatt.outlets.mqtt.outbox import Outbox
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.session import Format, HostLeftError, Session
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.results import Prediction


class MqttOutlet(Outlet[MqttSettings]):
    """Publishes rows of the frames, results, alarms and health to a broker.

    While the broker is unreachable, rows are owed; after reconnecting, they are sent from the record beside the live
    ones. Results, and without a record also rows, wait in a queue.
    """

    Settings: ClassVar[type[MqttSettings]] = MqttSettings
    title = "MQTT: rows, results and alarms for brokers and Sparkplug B hosts"

    def __init__(self, name: str, settings: MqttSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._record = framed_record(view)
        self._cursor = cursor_of(view, name, self.account)
        self._format: Format | None = None
        cursor = None if self._record is None else self._cursor
        self._outbox = Outbox(settings, settings.queue, self.account, cursor, self._missed)
        self._session: Session | None = None
        self._refused: str | None = None
        """Reason why the broker refused a message on this connection, or ``None``."""
        self._sent_health: tuple[object, float] = None, 0.0
        """State of the last health sent, and the time of sending, monotonic s."""

    def _missed(self, row: Any) -> None:
        if self._format is not None:
            self._format.missed(row)

    def _take_refusal(self, reason: str) -> None:
        self.account.count("messages refused")
        self._refused = reason

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over the waiting entries and the position of the previous outlet."""
        if isinstance(before, MqttOutlet):
            self._outbox.succeed(before._outbox)
            self._cursor.succeed(before._cursor)

    def offer(self, item: Item) -> None:
        """Queue the rows of frames, and results."""
        if isinstance(item, Frames):
            self._outbox.frames(item)
            if self._cursor.position.reached is None and self._outbox.last is not None:
                self._cursor.deliver(self._outbox.begun)  # rows of a start that never connects are owed, too
        elif isinstance(item, Prediction):
            self._outbox.prediction(item)
        elif not isinstance(item, Batch):
            self._outbox.result(item)

    def health(self, status: Mapping[str, Any]) -> None:
        """Send the health if its state changed, or ``health`` s after the last message."""
        session, now = self._session, time.monotonic()
        before, at = self._sent_health
        if session is None or not self._outbox.serving:
            return
        if before != status.get("state") or now - at >= self.settings.health:
            self._sent_health = status.get("state"), now
            session.status = status
            self._outbox.wake.set()

    def starting(self) -> bool:
        """True while no broker has accepted the connection."""
        return self._session is None

    def trouble(self) -> str | None:
        """Reason why something is not sent: host offline, record unreadable, messages refused, channels unknown."""
        session = self._session
        if session is not None and session.problem:
            return session.problem
        if session is not None and self._format is not None and not self._format.ready:
            return f"the primary host {self.settings.sparkplug.primary_host} is not online: all data wait for it"
        if self._refused:
            return f"the broker refuses messages ({self._refused}): check its access rules and limits"
        if self._outbox.unmatched:
            return f"channels: no channel of the frames matches {', '.join(self._outbox.unmatched)}"
        return self._cursor.problem

    async def run(self) -> None:
        """Connect, publish until cancelled, send waiting entries, disconnect. Raises ``OutletError``."""
        try:
            await self._serve()
        finally:
            await self._cursor.write()

    async def _serve(self) -> None:
        await self._cursor.open()
        tls = await asyncio.to_thread(tls_context, self.settings)
        format_ = self._format = self._format or self._made()
        will = format_.connect()
        if isinstance(format_, EdgeNode):
            self._cursor.born(format_.births)
            await self._cursor.write()
        self._refused = None
        client = self.settings.client or f"cellwatt-{self.view.site}-{self.view.cell}-{self.name}"
        link = Link(self.settings, client, will, tls, self._take_refusal, self.account)
        try:
            await link.open()
            self._sent_health = None, 0.0
            await self._use(link, format_)
        finally:
            await link.abort()

    async def _use(self, link: Link, format_: Format) -> None:
        parts = link, format_, self._outbox, self._cursor
        session = self._session = Session(self.settings, parts, self._record, self.view.cell, self.account)
        try:
            await session.serve()
        except (asyncio.CancelledError, HostLeftError):
            await session.stop()
            await link.close(with_will=format_.announced)
            raise
        finally:
            self._session = None
            session.end()

    def _made(self) -> Format:
        view = self.view
        if self.settings.format == "sparkplug":
            return EdgeNode(self.settings.sparkplug, view.site, view.cell, view.alarms, self._cursor.position.births)
        return PlainFormat(self.settings, view.site, view.cell, view.alarms)
