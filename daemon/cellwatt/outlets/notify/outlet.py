"""Notifies people of alarms."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Iterable, Mapping
from importlib.util import find_spec
from typing import Any, ClassVar, Final

from cellwatt.alarms import WORDS
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.notify.courier import Courier
from cellwatt.outlets.notify.ledger import FILE, Ledger
from cellwatt.outlets.notify.quiet import zone_of
from cellwatt.outlets.notify.settings import NotifySettings
from cellwatt.outlets.notify.texts import About
from cellwatt.results import Alarm, Event

for _library in ("aiohttp", "aiosmtplib"):  # loaded when the outlet runs; a missing one is reported at once
    if find_spec(_library) is None:
        raise ModuleNotFoundError(f"No module named {_library!r}", name=_library)

log = logging.getLogger(__name__)

INBOX: Final = 10_000
"""Most alarms that wait to be processed."""


class NotifyOutlet(Outlet[NotifySettings]):
    """Sends alarms to people by mail, webhook, ntfy and Home Assistant, each once.

    One task per recipient and mail address sends, so that none waits for another; a ledger on disk has the state of
    each.
    """

    Settings: ClassVar[type[NotifySettings]] = NotifySettings
    title = "Alarms to people: by mail, webhook, ntfy and Home Assistant"

    def __init__(self, name: str, settings: NotifySettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._inbox: deque[Alarm] = deque()
        self._fresh = asyncio.Event()
        self._couriers: dict[str, Courier] = {}
        self._folder = settings.folder or view.record_folder
        self._ledger = Ledger(None if self._folder is None else self._folder / FILE)
        self._read = False
        self._shelved: frozenset[str] = frozenset()
        """Ids of the alarms that were shelved when the alarm book was last read."""

    def offer(self, item: Item) -> None:
        """Queue an alarm; a full queue drops the oldest. Acknowledging and shelving wake the reader of the book."""
        if isinstance(item, Alarm):
            self._inbox.append(item)
            if len(self._inbox) > INBOX:
                self._inbox.popleft()
                self.account.count("alarms lost, queue full")
        if isinstance(item, Alarm) or (isinstance(item, Event) and item.kind in WORDS):
            self._fresh.set()

    def health(self, status: Mapping[str, Any]) -> None:
        """Read the alarm book: the end of a shelving has no event."""
        self._fresh.set()

    def succeed(self, before: Outlet[Any]) -> None:
        """Take over the ledger and the unprocessed alarms of the previous outlet."""
        if isinstance(before, NotifyOutlet):
            self._inbox.extendleft(reversed(before._inbox))
            if before._read and before._ledger.path == self._ledger.path:
                self._ledger, self._read = before._ledger, True

    def trouble(self) -> str | None:
        """The recipients that are not reached, and the reasons, in one line; ``None`` if there are none."""
        found = [text for courier in self._couriers.values() if (text := courier.trouble())]
        if self._ledger.problem is not None:
            found.append(self._ledger.problem)
        return "; ".join(found) or None

    async def run(self) -> None:
        """Send until cancelled; an attempt in progress then has three seconds to complete."""
        await self._begin()
        settings, view = self.settings, self.view
        about = About(view.site, view.cell, settings.page, zone_of(settings.zone))
        self._couriers = {
            name: Courier(name, to, settings, about, view.session, self._ledger, self.account, self._folder)
            for name, to in settings.each.items()
        }
        for alarm in self._missed():
            for courier in self._couriers.values():
                courier.take(alarm)
        self._fresh.set()  # the alarm book is read before a courier withdraws alarms
        async with asyncio.TaskGroup() as group:
            group.create_task(self._look())
            for courier in self._couriers.values():
                group.create_task(courier.run())

    async def _begin(self) -> None:
        """Read the ledger once, and delete the state of recipients that are no longer in the settings."""
        if not self._read:
            await asyncio.to_thread(self._ledger.read)
            self._read = True
            if self._ledger.path is None:
                log.warning("notify: without a record, alarms may be sent again after a restart")
            if self._ledger.problem is not None:
                log.warning("notify: %s; alarms may be sent again", self._ledger.problem)
                self.account.count("ledger: not readable")
            if self._ledger.unreadable:
                self.account.count("ledger: lines not readable", self._ledger.unreadable)
        for name, count in self._ledger.keep(self.settings.each).items():
            self.account.count(f"{name}, no recipient any more: alarms not told", count)

    def _missed(self) -> Iterable[Alarm]:
        """The newest message of each alarm of this session; the ledger knows which of them were sent."""
        journal = self.view.journal
        past = journal.past() if journal is not None else ()
        last = {item.id: item for _, item in past if isinstance(item, Alarm)}
        return (last | {s.alarm.id: s.published for s in self.view.alarms.up if s.published}).values()

    async def _look(self) -> None:
        """Pass new alarms to each recipient, and store the resulting items before anything is sent."""
        while True:
            await self._fresh.wait()
            self._fresh.clear()
            book = self.view.alarms
            # The end of a shelf is published only if the alarm has changed since it was shelved.
            back = [s.published for s in book.up if s.published is not None and s.alarm.id in self._shelved]
            alarms = [*self._inbox, *back]
            self._inbox.clear()
            unattended = {standing.alarm.id for standing in book.up if standing.acknowledgement is None}
            self._shelved = frozenset(standing.alarm.id for standing in book.shelved)
            for courier in self._couriers.values():
                for alarm in alarms:
                    courier.take(alarm)
                courier.heed(unattended, self._shelved)
            await self._ledger.flush()
