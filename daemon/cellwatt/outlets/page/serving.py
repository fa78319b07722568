"""The process that serves the page of a cell: ``python -m cellwatt.outlets.page.serving FD``, started by the outlet."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from cellwatt.door.settings import tls_context
from cellwatt.errors import ProtocolError
from cellwatt.frames import Layout
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.daemon import Daemon, main
from cellwatt.outlets.apart.wire import Kind
from cellwatt.outlets.page.access import Gate, proof_of
from cellwatt.outlets.page.app import Page, names_in
from cellwatt.outlets.page.archive import Archive, Desk
from cellwatt.outlets.page.arms import follow
from cellwatt.outlets.page.assets import Assets
from cellwatt.outlets.page.browsers import Browsers
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.rooms import OneRoom, Room, prefix
from cellwatt.outlets.page.sessions import FILE, Sessions
from cellwatt.outlets.page.settings import PageSettings
from cellwatt.outlets.page.streams import Hub
from cellwatt.outlets.zenoh.messages import parse_json

NICENESS: Final = 10
"""Data come before browsers: stages, which judge them, have 5."""


class Serving:
    """Serves one cell, told by the daemon what it says."""

    def __init__(self, daemon: Daemon, hello: Mapping[str, Any]) -> None:
        self._daemon = daemon
        self._settings = PageSettings.model_validate(hello["settings"])
        self._browsers = Browsers(self._settings.browsers)
        site, cell = hello["site"], hello["cell"]
        self._feed = Feed(site, cell, Hub(self._browsers), f"{prefix(site, cell)}/reports")
        self._feed.live.session = hello["session"]
        self._folder = None if hello["record"] is None else Path(hello["record"])
        self._desk = Desk()
        self._layout = Layout((), 1.0)

    async def run(self) -> None:
        """Serve until the daemon goes. Raises ``OutletError`` if that cannot be."""
        settings = self._settings
        sessions = Sessions(self._folder and self._folder / FILE, lambda name: proof_of(settings, name))
        assets = Assets()
        archive = Archive(self._folder, self._feed.cell, settings.reports, self._desk, settings.levels)
        context, names, *_ = await asyncio.gather(
            asyncio.to_thread(tls_context, settings),
            asyncio.to_thread(names_in, settings.certificate),
            asyncio.to_thread(sessions.load),
            asyncio.to_thread(assets.load),
        )
        gate = Gate(settings, sessions, names)
        page = Page(settings, gate, OneRoom(Room(self._feed, archive, self._daemon.order)), assets, self._browsers)
        await asyncio.to_thread(archive.start)
        helpers: list[asyncio.Task[None]] = []
        try:
            url = await page.start(context)
            self._daemon.say(Kind.READY, {"url": url})
            gc.collect()
            gc.freeze()
            helpers.append(
                asyncio.create_task(
                    self._daemon.beat(
                        lambda: {**self._browsers.counts, **gate.counts, **page.counts, **archive.counts()}
                    )
                )
            )
            helpers.append(asyncio.create_task(follow(self._feed, settings.arms, self._desk)))
            await self._daemon.hear(self._take)
        finally:
            for helper in helpers:
                helper.cancel()
            await page.stop()
            await gate.save()
            await asyncio.to_thread(archive.close)
            await asyncio.to_thread(self._desk.close)

    async def _take(self, kind: Kind, body: bytes) -> None:
        match kind:
            case Kind.LAYOUT:
                self._layout = wire.read_layout(body)
            case Kind.FRAMES:
                self._feed.take_frames(wire.read_frames(body, self._layout))
            case Kind.ITEM:
                told = parse_json(body)
                self._feed.take_item(told["kind"], told["body"])
            case Kind.HEALTH:
                self._feed.take_health(parse_json(body))
            case _:
                raise ProtocolError(f"the daemon does not say {kind.name}")


async def serve(daemon: Daemon, hello: Mapping[str, Any]) -> None:
    """Serve what the daemon tells, until it goes."""
    await Serving(daemon, hello).run()


if __name__ == "__main__":
    os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    main(serve, logging.INFO)
