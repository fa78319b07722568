"""The serving process' side of an outlet: receives the daemon's messages, reports to it, and sends it orders."""

from __future__ import annotations

import asyncio
import itertools
import logging
import pickle
import signal
import socket
import sys
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from cellwatt.errors import CellwattError, OutletError, ProtocolError
from cellwatt.frames import Frames, Layout
from cellwatt.outlets.apart import wire
from cellwatt.outlets.apart.wire import LIMIT, Kind
from cellwatt.progress.log_lines import log_to_stderr
from cellwatt.results import Event, Result

log = logging.getLogger(__name__)

BEAT: Final = 1.0
"""Time between two heartbeats, s."""
ANSWER: Final = 5.0
"""Longest time, s, for the daemon's answer to an order."""


@dataclass(frozen=True)
class Shown:
    """Handlers of the daemon's messages: frames; a result or event; health."""

    frames: Callable[[Frames], Awaitable[None] | None] | None = None
    item: Callable[[Result | Event], Awaitable[None] | None] | None = None
    health: Callable[[Mapping[str, Any]], Awaitable[None] | None] | None = None


class Daemon:
    """The daemon at the other end of the socket."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer
        self._numbers = itertools.count()
        self._asked: dict[int, asyncio.Future[Mapping[str, Any]]] = {}
        self._broken = 0
        self._layout = Layout((), 1.0)

    def say(self, kind: Kind, body: Any) -> None:
        """Send a message, unless the daemon has disconnected."""
        if not self._writer.is_closing():
            self._writer.write(wire.from_process(kind, body))

    async def serve(self, url: str, counts: Callable[[], Mapping[str, int]], shown: Shown) -> None:
        """Report ready at ``url``, send a heartbeat each second, and pass the daemon's messages to ``shown``.

        Until the daemon disconnects; a message that fails is skipped and counted.
        """
        self.say(Kind.READY, {"url": url})
        beating = asyncio.create_task(self._beat(counts))
        try:
            while (got := await wire.receive(self._reader)) is not None:
                try:
                    if (work := self._shown(shown, got[0], pickle.loads(got[1]))) is not None:
                        await work
                except Exception:  # one bad message must not end the others
                    self._broken += 1
                    if self._broken == 1:
                        log.exception("a message of kind %s cannot be shown", got[0].name)
        finally:
            beating.cancel()

    def _shown(self, shown: Shown, kind: Kind, body: Any) -> Awaitable[None] | None:
        match kind:
            case Kind.ANSWER:
                self._answered(body)
            case Kind.LAYOUT:
                self._layout = body
            case Kind.FRAMES if shown.frames is not None:
                return shown.frames(Frames(self._layout, *body))
            case Kind.ITEM if shown.item is not None:
                return shown.item(body)
            case Kind.HEALTH if shown.health is not None:
                return shown.health(body)
            case _:
                raise ProtocolError(f"the daemon sends no {kind.name} messages")
        return None

    def _answered(self, answer: Mapping[str, Any]) -> None:
        waiting = self._asked.get(answer["number"])
        if waiting is not None and not waiting.done():
            waiting.set_result(answer)

    async def order(self, order: Mapping[str, Any]) -> Any:
        """Send the daemon an order and return its answer. Raises ``CellwattError`` with the daemon's reason."""
        number = next(self._numbers)
        answered = self._asked[number] = asyncio.get_running_loop().create_future()
        try:
            self.say(Kind.ORDER, {"number": number, **order})
            async with asyncio.timeout(ANSWER):
                answer = await answered
        except TimeoutError:
            raise OutletError("the cell's daemon does not answer: try again") from None
        finally:
            del self._asked[number]
        if answer["error"] is not None:
            raise CellwattError(answer["error"])
        return answer["answer"]

    async def _beat(self, counts: Callable[[], Mapping[str, int]]) -> None:
        """Send a heartbeat with the current ``counts`` each second."""
        while True:
            broken = {"messages not shown": self._broken} if self._broken else {}
            self.say(Kind.ALIVE, {"counts": {**counts(), **broken}})
            await asyncio.sleep(BEAT)


Work = Callable[[Daemon, Mapping[str, Any]], Awaitable[None]]
"""Serves the daemon's data, given its hello message; raises ``CellwattError`` if it cannot."""


async def serve(connection: socket.socket, work: Work) -> int:
    """Serve the daemon at the other end of a socket; return the exit code."""
    reader, writer = await asyncio.open_connection(sock=connection, limit=LIMIT)
    loop, here = asyncio.get_running_loop(), asyncio.current_task()
    assert here is not None
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, here.cancel)
    try:
        hello = await wire.receive(reader)
        if hello is None:
            return 0
        await work(Daemon(reader, writer), pickle.loads(hello[1]))
    except asyncio.CancelledError:
        pass  # asked to stop by a signal
    except CellwattError as error:
        writer.write(wire.from_process(Kind.FAILED, {"error": str(error)}))
        return 1
    finally:
        writer.close()
    return 0


def main(work: Work, level: int) -> None:
    """Serve the parent's data from an inherited socket; log messages from ``level`` up."""
    log_to_stderr(level)
    sys.exit(asyncio.run(serve(socket.socket(fileno=int(sys.argv[1])), work)))
