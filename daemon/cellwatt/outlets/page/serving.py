"""The process that serves the page of a cell: ``python -m cellwatt.outlets.page.serving FD``, started by the outlet."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from cellwatt.outlets.apart.daemon import Daemon, Shown, main
from cellwatt.outlets.page.app import served
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.outlet import PageSettings
from cellwatt.outlets.page.rooms import OneRoom, Room, follow_arms, prefix
from cellwatt.outlets.page.sessions import FILE
from cellwatt.outlets.page.streams import Browsers, Hub

NICENESS: Final = 10
"""Data come before browsers: stages, which judge them, have 5."""


async def serve(daemon: Daemon, hello: Mapping[str, Any]) -> None:
    """Serve what the daemon tells, until it goes. Raises ``OutletError`` if that cannot be."""
    settings, site, cell = PageSettings.model_validate(hello["settings"]), hello["site"], hello["cell"]
    browsers, desk = Browsers(settings.browsers), Desk()
    feed = Feed(site, cell, Hub(browsers), f"{prefix(site, cell)}/reports")
    feed.live.session = hello["session"]
    folder = None if hello["record"] is None else Path(hello["record"])
    archive = Archive(folder, cell, settings.reports, desk, settings.levels)
    shown = Shown(feed.take_frames, feed.take_item, feed.take_health)
    try:
        await asyncio.to_thread(archive.start)
        room = OneRoom(Room(feed, archive, daemon.order))
        async with served(settings, room, browsers, folder and folder / FILE) as page:
            gc.collect()
            gc.freeze()
            arms = asyncio.create_task(follow_arms(feed, settings.arms, desk))
            try:
                await daemon.serve(page.url, lambda: {**page.counts, **archive.counts()}, shown)
            finally:
                arms.cancel()
    finally:
        await asyncio.to_thread(archive.close)
        await asyncio.to_thread(desk.close)


if __name__ == "__main__":
    os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    main(serve, logging.INFO)
