"""All cells of a site, found by their liveliness tokens and health; a cell open in a browser is followed completely."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.cells import Cell, Mode, OneCell, plant_cell
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.outlets.zenoh.keys import PREFIX, escape
from cellwatt.outlets.zenoh.link import LinkSettings, close_session, open_beside
from cellwatt.outlets.zenoh.received import read_health
from cellwatt.subscriber import Subscriber

if TYPE_CHECKING:
    import zenoh

log = logging.getLogger(__name__)

WANT: Final = ("frame", "interval", "task", "energy", "prediction", "alarm", "event", "health")
"""Topics that a page shows."""
UNREADABLE: Final = (KeyError, TypeError, ValueError, AttributeError)
"""Exceptions from a message of another version of cellwatt, or of a sender that impersonates a cell."""
PAUSE: Final = 2.0
"""Pause, s, before a failed link is opened again."""


async def watch(link: LinkSettings, feed: Feed, verify: Path | None = None) -> None:
    """Pass all messages of a cell to its feed, until cancelled; report a failed link to browsers, and open it again.

    ``verify`` is the public key of a cell that signs its messages.
    """
    unreadable = 0
    while True:
        try:
            async with Subscriber(feed.site, feed.cell, link, want=WANT, verify=verify) as subscriber:
                async for message in subscriber:
                    try:
                        feed.take(message)
                    except UNREADABLE as error:
                        unreadable += 1
                        if unreadable == 1:
                            log.warning("%s/%s: a message cannot be shown: %r", feed.site, feed.cell, error)
        except OutletError as error:
            log.warning("%s/%s: %s; trying again", feed.site, feed.cell, error)
            feed.take_gap(f"the link to the cell failed: {error}")
        await asyncio.sleep(PAUSE)


MOST_OPEN: Final = 16
"""Largest number of cells followed completely at the same time."""
KEPT: Final = 60.0
"""Time, s, for which a cell is still followed after its last browser disconnected."""


LOOK: Final = 2.0
"""Interval, s, between two messages to browsers."""
MOST_CELLS: Final = 2000
"""Largest number of listed cells."""
FORGOTTEN: Final = 86400.0
"""Time, s, after which a cell that is gone is removed from the list."""
AT_ONCE: Final = 50
"""Number of cells whose health is read before the loop runs other tasks."""
_AGE: Final = 5.0
"""Age, s, of the last health from which on each change of the age is sent to browsers."""


@dataclass
class _Cell:
    """State of one cell; times are monotonic, s. ``waiting`` is its newest health message, not yet decoded.

    ``followed`` is the cell while ``task`` follows it completely; ``used`` is the time of the last request.
    """

    heard: float | None = None
    gone: float | None = None
    waiting: zenoh.Sample | None = None
    status: Mapping[str, Any] = field(default_factory=dict)
    followed: Cell | None = None
    task: asyncio.Task[None] | None = None
    used: float = 0.0


class Plant:
    """The cells of a site behind a link, with the interface of ``OneCell``; ``run`` follows them.

    Zenoh calls back in its own threads, which hold this object: it must not hold Zenoh's session. Samples are passed to
    the event loop.
    """

    mode: Mode = "plant"
    acts = False

    def __init__(self, link: LinkSettings, site: str, browsers: Browsers, desk: Desk) -> None:
        self.site, self.hub, self._link = site, Hub(browsers), link
        self._known: dict[str, _Cell] = {}
        self._sent: dict[str, dict[str, Any]] = {}
        self._browsers, self._desk = browsers, desk
        self._closing: set[asyncio.Task[None]] = set()
        """Cancelled tasks whose links are not closed yet."""
        self._loop = asyncio.get_running_loop()
        self._unreadable = 0

    # cells ----------------------------------------------------------------------------------------

    @property
    def names(self) -> Sequence[tuple[str, str]]:
        """See ``OneCell.names``."""
        return [(self.site, cell) for cell in sorted(self._known)]

    async def cell(self, site: str, name: str) -> Cell:
        """See ``OneCell.cell``; starts to follow the cell."""
        if site != self.site:
            raise KeyError(name)
        known = self._known[name]
        known.used = time.monotonic()
        if known.followed is None:
            if sum(other.followed is not None for other in self._known.values()) >= MOST_OPEN:
                raise OutletError(f"{MOST_OPEN} cells are open, the maximum: close one and wait a minute")
            feed = Feed(site, name, Hub(self._browsers))
            with contextlib.suppress(*UNREADABLE):
                if known.status:
                    feed.take_health(known.status)
            known.followed = Cell(feed, Archive(None, name, None, self._desk))
            known.task = asyncio.create_task(watch(self._link, feed))
        return known.followed

    def _leave(self, known: _Cell) -> None:
        task, known.task, known.followed = known.task, None, None
        if task is not None:
            self._closing.add(task)
            task.add_done_callback(self._closing.discard)
            task.cancel()

    def summary(self) -> list[dict[str, Any]]:
        """See ``OneCell.summary``."""
        return [self._summary(cell) for cell in sorted(self._known)]

    def _summary(self, name: str) -> dict[str, Any]:
        cell = self._known[name]
        age = None if cell.heard is None else round(time.monotonic() - cell.heard, 1)
        try:
            return plant_cell(self.site, name, cell.status, age, gone=cell.gone is not None)
        except UNREADABLE:
            return plant_cell(self.site, name, {}, age, gone=cell.gone is not None)

    # messages -------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Follow the site until cancelled. Raises ``OutletError`` if the link cannot be opened."""
        session: zenoh.Session | None = None
        try:
            session = await open_beside(self._link)
            await asyncio.to_thread(self._subscribe, session)
            while True:
                await asyncio.sleep(LOOK)
                await self._look()
        finally:
            for known in self._known.values():  # also cells opened before the link was open
                self._leave(known)
            await asyncio.gather(*self._closing, return_exceptions=True)
            if session is not None:
                await asyncio.to_thread(close_session, session)

    def _subscribe(self, session: zenoh.Session) -> None:
        root = f"{PREFIX}/{escape(self.site)}/*"
        session.liveliness().declare_subscriber(root, self._later(self._on_token), history=True)
        session.declare_subscriber(f"{root}/health", self._later(self._on_health))

    def _later(self, take: Callable[[str, Any], None]) -> Callable[[Any], None]:
        """A callback that calls ``take`` on the event loop, with the name of the cell and the sample."""

        def call(sample: Any) -> None:
            with contextlib.suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(take, unquote(str(sample.key_expr).split("/")[2]), sample)

        return call

    def _of(self, name: str) -> _Cell | None:
        cell = self._known.get(name)
        if cell is None and len(self._known) < MOST_CELLS:
            cell = self._known[name] = _Cell()
        return cell

    def _on_token(self, name: str, sample: Any) -> None:
        import zenoh

        if (cell := self._of(name)) is not None:
            cell.gone = None if sample.kind == zenoh.SampleKind.PUT else time.monotonic()

    def _on_health(self, name: str, sample: Any) -> None:
        if (cell := self._of(name)) is not None:
            cell.waiting, cell.heard = sample, time.monotonic()

    async def _look(self) -> None:
        """Decode the newest health of each cell, and send the changed cells to browsers."""
        now, forgotten = time.monotonic(), False
        for index, (name, cell) in enumerate(list(self._known.items())):
            if index % AT_ONCE == 0:
                await asyncio.sleep(0)
            if cell.waiting is not None:
                try:
                    cell.status = read_health(cell.waiting)[1].status
                except ProtocolError as error:
                    self._unreadable += 1
                    if self._unreadable == 1:
                        log.warning("%s: a message cannot be read: %.300s", name, error)
                cell.waiting = None
            if cell.followed is not None and len(cell.followed.feed.hub):
                cell.used = now
            elif now - cell.used > KEPT:
                self._leave(cell)
            if cell.gone is not None and now - cell.gone > FORGOTTEN and cell.followed is None:
                del self._known[name]
                self._sent.pop(name, None)
                forgotten = True
        changed = [figures for name in self._known if (figures := self._changed(name)) is not None]
        if changed:
            self.hub.tell("plant", {"cells": changed})
        if forgotten:
            self.hub.end()  # browsers request the list of cells again

    def _changed(self, name: str) -> dict[str, Any] | None:
        figures = self._summary(name)
        quiet = (figures["age_s"] or 0.0) < _AGE
        before = self._sent.get(name)
        self._sent[name] = shown = {k: v for k, v in figures.items() if k != "age_s" or not quiet}
        return None if shown == before else figures


Cells = OneCell | Plant
"""All cells of a page."""
