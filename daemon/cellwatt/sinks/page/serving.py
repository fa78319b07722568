"""The process that serves the page of a cell: ``python -m cellwatt.sinks.page.serving FD``, started by the sink."""

from __future__ import annotations

import asyncio
import gc
import itertools
import logging
import os
import signal
import socket
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from cellwatt.errors import CellwattError, ProtocolError, SinkError
from cellwatt.frames import Layout
from cellwatt.publish.messages import parse_json
from cellwatt.sinks.listening import tls_context
from cellwatt.sinks.page import wire
from cellwatt.sinks.page.access import Gate, proof_of
from cellwatt.sinks.page.app import Page, names_in
from cellwatt.sinks.page.archive import Archive, Desk
from cellwatt.sinks.page.arms import follow
from cellwatt.sinks.page.assets import Assets
from cellwatt.sinks.page.browsers import Browsers
from cellwatt.sinks.page.feed import Feed
from cellwatt.sinks.page.rooms import OneRoom, Room, prefix
from cellwatt.sinks.page.sessions import FILE, Sessions
from cellwatt.sinks.page.settings import PageSettings
from cellwatt.sinks.page.streams import Hub
from cellwatt.sinks.page.wire import Kind

log = logging.getLogger(__name__)

NICENESS: Final = 10
"""Data come before browsers: stages, which judge them, have 5."""
BEAT: Final = 1.0
"""s between two signs of life."""
ANSWER: Final = 5.0
"""Longest time, s, for the daemon's answer to an order."""


class Serving:
    """Serves one cell, told through a socket, until that closes or the process is told to end."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, hello: Mapping[str, Any]) -> None:
        self._reader, self._writer = reader, writer
        self._settings = PageSettings.model_validate(hello["settings"])
        self._browsers = Browsers(self._settings.browsers)
        site, cell = hello["site"], hello["cell"]
        self._feed = Feed(site, cell, Hub(self._browsers), f"{prefix(site, cell)}/reports")
        self._feed.live.session = hello["session"]
        self._folder = None if hello["record"] is None else Path(hello["record"])
        self._desk = Desk()
        self._layout = Layout((), 1.0)
        self._numbers = itertools.count()
        self._asked: dict[int, asyncio.Future[str | None]] = {}
        self._broken = 0

    async def run(self) -> None:
        """Serve. Raises ``SinkError`` if that cannot be."""
        settings = self._settings
        sessions = Sessions(self._folder and self._folder / FILE, lambda name: proof_of(settings, name))
        assets = Assets()
        archive = Archive(self._folder, self._feed.cell, settings.reports, self._desk)
        context, names, *_ = await asyncio.gather(
            asyncio.to_thread(tls_context, settings),
            asyncio.to_thread(names_in, settings.certificate),
            asyncio.to_thread(sessions.load),
            asyncio.to_thread(assets.load),
        )
        gate = Gate(settings, sessions, names)
        page = Page(settings, gate, OneRoom(Room(self._feed, archive, self._order)), assets, self._browsers)
        await asyncio.to_thread(archive.start)
        helpers: list[asyncio.Task[None]] = []
        try:
            url = await page.start(context)
            self._say(Kind.READY, {"url": url})
            gc.collect()
            gc.freeze()
            helpers.append(asyncio.create_task(self._beat()))
            helpers.append(asyncio.create_task(follow(self._feed, settings.arms, self._desk)))
            await self._listen()
        finally:
            for helper in helpers:
                helper.cancel()
            await page.stop()
            await gate.save()
            await asyncio.to_thread(archive.close)
            await asyncio.to_thread(self._desk.close)

    # from the daemon ------------------------------------------------------------------------------

    async def _listen(self) -> None:
        while (got := await wire.receive(self._reader)) is not None:
            try:
                self._take(*got)
            except Exception:  # of one message: the others are worth showing
                self._broken += 1
                if self._broken == 1:
                    log.exception("a message of kind %s cannot be shown", got[0].name)

    def _take(self, kind: Kind, body: bytes) -> None:
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
            case Kind.ANSWER:
                told = parse_json(body)
                waiting = self._asked.get(told["number"])
                if waiting is not None and not waiting.done():
                    waiting.set_result(told["error"])
            case _:
                raise ProtocolError(f"the daemon does not say {kind.name}")

    # to the daemon --------------------------------------------------------------------------------

    async def _order(self, order: Mapping[str, Any]) -> None:
        """Have the daemon do something. Raises ``CellwattError`` with its reason."""
        number = next(self._numbers)
        answered = self._asked[number] = asyncio.get_running_loop().create_future()
        try:
            self._say(Kind.ORDER, {"number": number, **order})
            async with asyncio.timeout(ANSWER):
                error = await answered
        except TimeoutError:
            raise SinkError("the cell's daemon does not answer: try again") from None
        finally:
            del self._asked[number]
        if error is not None:
            raise CellwattError(error)

    async def _beat(self) -> None:
        while True:
            counts = {**self._browsers.counts, **({"messages not shown": self._broken} if self._broken else {})}
            self._say(Kind.ALIVE, {"browsers": len(self._browsers), "counts": counts})
            await asyncio.sleep(BEAT)

    def _say(self, kind: Kind, body: Any) -> None:
        if not self._writer.is_closing():
            self._writer.write(wire.json_message(kind, body))


async def serve(connection: socket.socket) -> int:
    """Serve what the other end of a socket tells; return the exit code."""
    reader, writer = await asyncio.open_connection(sock=connection, limit=2**20)
    loop, here = asyncio.get_running_loop(), asyncio.current_task()
    assert here is not None
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, here.cancel)
    try:
        hello = await wire.receive(reader)
        if hello is None:
            return 0
        await Serving(reader, writer, parse_json(hello[1])).run()
    except asyncio.CancelledError:
        pass  # it was told to end
    except CellwattError as error:
        writer.write(wire.json_message(Kind.FAILED, {"error": str(error)}))
        return 1
    finally:
        writer.close()
    return 0


def main() -> None:
    """Serve what the parent tells through an inherited socket."""
    os.setpriority(os.PRIO_PROCESS, 0, max(NICENESS, os.getpriority(os.PRIO_PROCESS, 0)))
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s")
    sys.exit(asyncio.run(serve(socket.socket(fileno=int(sys.argv[1])))))


if __name__ == "__main__":
    main()
