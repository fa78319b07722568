"""The MQTT outlet: JSON topics for any consumer, or Sparkplug B for SCADA hosts."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from cellwatt.batch import Batch
from cellwatt.errors import OutletError
from cellwatt.frames import Frames
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.forward import Flow, Forwarder, Peer, cursor_of
from cellwatt.outlets.mqtt.edge_node import EdgeNode
from cellwatt.outlets.mqtt.link import WINDOW, Link, tls_context
from cellwatt.outlets.mqtt.outbox import Outbox
from cellwatt.outlets.mqtt.plain import PlainFormat
from cellwatt.outlets.mqtt.session import Entry, Format, HostLeftError, Session
from cellwatt.outlets.mqtt.settings import MqttSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.remote import NotNowError
from cellwatt.outlets.selection import Row, Selection
from cellwatt.results import Event, Interval, Prediction


class MqttOutlet(Outlet[MqttSettings], Peer[Entry]):
    """Publishes rows of the frames, results, alarms and health to a broker.

    A forwarder delivers rows, alarms, tasks and energies; everything else is sent by the session.
    """

    Settings: ClassVar[type[MqttSettings]] = MqttSettings
    title = "MQTT: rows, results and alarms for brokers and Sparkplug B hosts"

    def __init__(self, name: str, settings: MqttSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        chosen = {option: getattr(settings, option) for option in Selection.model_fields}
        flow = Flow.model_construct(**chosen, batch=WINDOW, every=0.0, queue=settings.queue)
        self._cursor = cursor_of(view, name, self.account)
        self._forwarder: Forwarder[Entry] = Forwarder(name, self, flow, view, self._cursor, settings.backfill)
        self._outbox = Outbox(settings, settings.queue, self.account)
        self._rate = settings.rate
        """Rate of the frames, Hz."""
        self._format: Format | None = None
        self._session: Session | None = None
        self._turn = 0
        """Number of failed connections; it selects the next broker."""
        self._refused: str | None = None
        """Reason why the broker refused a message on this connection, or ``None``."""
        self._sent_health: tuple[object, float] = None, 0.0
        """State of the last health sent, and the time of sending, monotonic s."""

    def _take_refusal(self, reason: str) -> None:
        self.account.count("messages refused")
        self._refused = reason

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over the waiting entries and the position of the previous outlet."""
        if isinstance(before, MqttOutlet):
            self._forwarder.succeed(before._forwarder)
            self._outbox.results.extendleft(reversed(before._outbox.results))

    def offer(self, item: Item) -> None:
        """Queue frames and results; predictions only while connected."""
        if isinstance(item, Interval | Event):
            self._outbox.result(item, not self.ready)
        elif isinstance(item, Prediction) and self.ready:
            self._outbox.prediction(item, self._rate)
        elif isinstance(item, Prediction):
            self.account.count("predictions dropped")
        elif not isinstance(item, Batch):
            self._rate = item.layout.rate if isinstance(item, Frames) else self._rate
            self._forwarder.offer(item)
            self._forwarder.wake.set()

    # the broker as a peer ---------------------------------------------------------------------------

    @property
    def ready(self) -> bool:
        """See ``Peer.ready``."""
        return self._session is not None and self._session.ready

    def row(self, row: Row, units: Mapping[str, str]) -> Row:
        """See ``Peer.row``; its messages are made when it is sent."""
        return row

    def result(self, result: Archived) -> Archived:
        """See ``Peer.result``."""
        return result

    async def send(self, messages: Sequence[Entry]) -> Mapping[str, int]:
        """See ``Peer.send``."""
        if self._session is None or not self._session.ready:
            raise NotNowError("not connected")
        refused = await self._session.send(messages, past=self._forwarder.filling)
        return {"refused": refused} if refused else {}

    # health and connections -------------------------------------------------------------------------

    def health(self, status: Mapping[str, Any]) -> None:
        """Send the health if its state changed, or ``health`` s after the last message."""
        session, now = self._session, time.monotonic()
        before, at = self._sent_health
        if session is None or not session.ready:
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
        if self._forwarder.unread:
            return self._forwarder.unread
        if self._session is not None and self._format is not None and not self._format.ready:
            return f"the primary host {self.settings.sparkplug.primary_host} is not online: all data wait for it"
        if self._refused:
            return f"the broker refuses messages ({self._refused}): check its access rules and limits"
        picker = self._forwarder.picker
        if picker.layout.channels and picker.unmatched:
            return f"channels: no channel of the frames matches {', '.join(picker.unmatched)}"
        return self._cursor.problem

    async def run(self) -> None:
        """Connect, publish until cancelled, send waiting entries, disconnect. Raises ``OutletError``."""
        await self._cursor.open()
        try:
            await self._serve(self.settings.at(self._turn))
        except OutletError:
            self._turn += 1
            raise
        finally:
            await self._forwarder.leave()

    async def _serve(self, settings: MqttSettings) -> None:
        tls = await asyncio.to_thread(tls_context, settings)
        format_ = self._format = self._format or self._made()
        will = format_.connect()
        if isinstance(format_, EdgeNode):
            self._cursor.born(format_.births)
            await self._cursor.write()
        self._refused = None
        link = Link(settings, settings.client or self._client, will, tls, self._take_refusal, self.account)
        try:
            await link.open()
            self._sent_health = None, 0.0
            await self._use(link, format_, settings)
        finally:
            await link.abort()

    async def _use(self, link: Link, format_: Format, settings: MqttSettings) -> None:
        session = Session(settings, link, format_, self._forwarder, self._outbox, self.account)
        self._session = session
        try:
            await self._forwarder.collect()
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

    @property
    def _client(self) -> str:
        return f"cellwatt-{self.view.site}-{self.view.cell}-{self.name}"
