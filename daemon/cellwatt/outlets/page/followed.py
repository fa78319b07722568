"""Follows a cell over the bus for browsers; of a plant those that somebody looks at, and a while after that."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cellwatt.errors import OutletError
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.rooms import Room
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.outlets.zenoh.received import Health
from cellwatt.subscriber import LinkSettings, Subscriber

log = logging.getLogger(__name__)

WANT: Final = ("frame", "interval", "task", "energy", "prediction", "alarm", "event", "health")
"""Topics that a page shows."""
UNREADABLE: Final = (KeyError, TypeError, ValueError, AttributeError)
"""What a message of another version of cellwatt, or of somebody who speaks in a cell's name, may raise."""
PAUSE: Final = 2.0
"""s before a link that failed is tried again."""


async def watch(link: LinkSettings, feed: Feed, verify: Path | None = None) -> None:
    """Give a feed all that its cell publishes, until cancelled; a link that fails is told to browsers and tried again.

    ``verify`` is the public key of a cell that signs.
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
"""Cells that are followed in full at the same time."""
KEPT: Final = 60.0
"""s that a cell is followed after the last browser has left it."""


@dataclass
class _Open:
    room: Room
    task: asyncio.Task[None]
    used: float
    """Monotonic time, s, at which somebody last asked."""


class Followed:
    """Rooms of cells by name, opened when they are asked for."""

    def __init__(self, link: LinkSettings, browsers: Browsers, desk: Desk) -> None:
        self._link, self._browsers, self._desk = link, browsers, desk
        self._rooms: dict[str, _Open] = {}
        self._left: set[asyncio.Task[None]] = set()
        """Cells that are being left: their links are still to be closed."""

    def room(self, site: str, cell: str, health: Health | None) -> Room:
        """The room of a cell; a new one begins with ``health``. Raises ``OutletError`` where too many are open."""
        found = self._rooms.get(cell)
        if found is None:
            if len(self._rooms) >= MOST_OPEN:
                raise OutletError(f"{MOST_OPEN} cells are being looked at, the most that may: close one, wait a minute")
            feed = Feed(site, cell, Hub(self._browsers))
            if health is not None:
                with contextlib.suppress(*UNREADABLE):
                    feed.take_health(health.status)
            room = Room(feed, Archive(None, cell, None, self._desk))
            found = self._rooms[cell] = _Open(room, asyncio.create_task(watch(self._link, feed)), 0.0)
        found.used = time.monotonic()
        return found.room

    def leave(self, now: float) -> None:
        """Leave the cells at which nobody has looked for a while, at monotonic time ``now``, s."""
        for cell, opened in list(self._rooms.items()):
            if len(opened.room.feed.hub):
                opened.used = now
            elif now - opened.used > KEPT:
                self._leave(cell)

    async def close(self) -> None:
        """Leave all cells; return when the links to them are closed."""
        for cell in list(self._rooms):
            self._leave(cell)
        await asyncio.gather(*self._left, return_exceptions=True)

    def _leave(self, cell: str) -> None:
        task = self._rooms.pop(cell).task
        self._left.add(task)
        task.add_done_callback(self._left.discard)
        task.cancel()
