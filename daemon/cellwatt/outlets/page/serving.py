"""Serves a page: for the daemon of a cell (``python -m …page.serving FD``), or standalone, from the bus."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from collections.abc import Callable, Coroutine, Mapping
from pathlib import Path
from typing import Any, Final

from cellwatt.outlets.apart.daemon import Daemon, Shown, main
from cellwatt.outlets.page.app import served
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.cells import Cell, OneCell, follow_arms, prefix
from cellwatt.outlets.page.dropped import Drops
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.plant import Cells, Plant, watch
from cellwatt.outlets.page.sessions import FILE
from cellwatt.outlets.page.streams import Browsers, Hub
from cellwatt.runtime.processes.rights import settle_memory
from cellwatt.runtime.tasks import plain_errors
from cellwatt.subscriber import LinkSettings

NICENESS: Final = 10
"""Niceness of the serving process: data take precedence over browsers."""


async def serve(daemon: Daemon, hello: Mapping[str, Any]) -> None:
    """Serve the daemon's messages until it ends. Raises ``OutletError`` if the page cannot be served."""
    settings, site, cell, folder = (hello[name] for name in ("settings", "site", "cell", "record_folder"))
    browsers, desk = Browsers(settings.browsers), Desk()
    feed = Feed(site, cell, Hub(browsers), f"{prefix(site, cell)}/reports")
    feed.live.session = hello["session"]
    archive = Archive(folder, cell, settings.reports, desk, settings.levels)
    shown = Shown(feed.take_frames, feed.take_item, feed.take_health)
    try:
        shown_cell = OneCell(Cell(feed, archive, daemon.order))
        async with served(settings, shown_cell, browsers, folder and folder / FILE) as page:
            settle_memory()
            archive.start()
            arms = asyncio.create_task(follow_arms(feed, settings.arms))
            try:
                await daemon.serve(page.url, lambda: {**page.counts, **archive.counts}, shown)
            finally:
                arms.cancel()
    finally:
        await asyncio.to_thread(archive.close)
        await asyncio.to_thread(desk.close)


async def view(
    settings: PageSettings,
    link: LinkSettings | None,
    site: str,
    cell: str | None,
    verify: Path | None,
    seconds: float | None,
    tell: Callable[[str], object],
) -> None:
    """Serve the page of ``cell``, or of all cells of the site if it is ``None``, for ``seconds`` or until cancelled.

    Without a ``link`` the page serves dropped recordings only. ``tell`` is called with the address. Logins end with
    this call. Raises ``OutletError`` if the page cannot be served.
    """
    browsers, desk, drops = Browsers(settings.browsers), Desk(), Drops()
    try:
        with plain_errors():
            async with asyncio.TaskGroup() as group:
                cells: Cells = OneCell(None)
                following: list[Coroutine[Any, Any, None]] = []
                if link is not None and cell is None:
                    cells = Plant(link, site, browsers, desk)
                    following = [cells.run()]
                elif link is not None and cell is not None:
                    feed = Feed(site, cell, Hub(browsers), f"{prefix(site, cell)}/reports")
                    cells = OneCell(Cell(feed, Archive(None, cell, settings.reports, desk)))
                    following = [watch(link, feed, verify), follow_arms(feed, settings.arms)]
                tasks = [group.create_task(work) for work in following]
                async with served(settings, cells, browsers, drops=drops) as page:
                    tell(f"the page is at {page.url}")
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(seconds):
                            await asyncio.Event().wait()
                for task in tasks:  # not if view is cancelled: the group cancels them, and twice would interrupt
                    task.cancel()
    finally:
        await asyncio.to_thread(desk.close)


if __name__ == "__main__":
    os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    main(serve, logging.INFO)
