"""Serves a page by itself, fed from the bus: of one cell, or of all cells of a site."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from cellwatt.outlets.page.app import served
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.dropped import Drops
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.followed import watch
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.plant import Plant, Rooms
from cellwatt.outlets.page.rooms import OneRoom, Room, follow_arms, prefix
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.runtime.tasks import plain_errors
from cellwatt.subscriber import LinkSettings


async def view(
    settings: PageSettings,
    link: LinkSettings | None,
    site: str,
    cell: str | None,
    verify: Path | None,
    seconds: float | None,
    tell: Callable[[str], object],
) -> None:
    """Serve the page of a cell, ``None`` for all of the site, for ``seconds`` or until cancelled.

    Without a ``link`` it is a page for recordings alone.

    ``tell`` is given the address. Logins end with this call. Raises ``OutletError`` if the page cannot be served.
    """
    browsers, desk, drops = Browsers(settings.browsers), Desk(), Drops()
    try:
        with plain_errors():
            async with asyncio.TaskGroup() as group:
                rooms, following = _rooms(settings, link, site, cell, verify, browsers, desk)
                tasks = [group.create_task(work) for work in following]
                async with served(settings, rooms, browsers, drops=drops) as page:
                    tell(f"the page is at {page.url}")
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(seconds):
                            await asyncio.Event().wait()
                for task in tasks:  # where this is cancelled, the group does it, and twice would cut their ends short
                    task.cancel()
    finally:
        await asyncio.to_thread(desk.close)


def _rooms(
    settings: PageSettings,
    link: LinkSettings | None,
    site: str,
    cell: str | None,
    verify: Path | None,
    browsers: Browsers,
    desk: Desk,
) -> tuple[Rooms, list[Coroutine[Any, Any, None]]]:
    """What is shown, and what follows it."""
    if link is None:
        return OneRoom(None), []
    if cell is None:
        plant = Plant(link, site, browsers, desk)
        return plant, [plant.run()]
    feed = Feed(site, cell, Hub(browsers), f"{prefix(site, cell)}/reports")
    room = Room(feed, Archive(None, cell, settings.reports, desk))
    return OneRoom(room), [watch(link, feed, verify), follow_arms(feed, settings.arms, desk)]
