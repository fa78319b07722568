"""The process that serves a cell over OPC UA: ``python -m cellwatt.outlets.opc_ua.serving FD``."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from typing import Any

from cellwatt.errors import CellwattError, OutletError, ProtocolError
from cellwatt.outlets.apart.daemon import Daemon, main
from cellwatt.outlets.apart.wire import Kind
from cellwatt.outlets.opc_ua.arrays import bound_arrays
from cellwatt.outlets.opc_ua.outlet import ACKNOWLEDGED
from cellwatt.outlets.opc_ua.served import CellServer, quiet
from cellwatt.outlets.zenoh.messages import parse_json


class Serving:
    """One server, told by the daemon what the cell says."""

    def __init__(self, daemon: Daemon, settings: Mapping[str, Any]) -> None:
        self._daemon = daemon
        self._server = CellServer(settings, self._order)

    async def run(self) -> None:
        """Serve until the daemon goes. Raises ``OutletError`` if that cannot be."""
        try:
            url = await self._server.open()
        except (OSError, ValueError) as error:
            told = getattr(error, "strerror", None) or str(error)
            raise OutletError(f"the OPC UA server cannot listen or be made: {told}") from error
        self._daemon.say(Kind.READY, {"url": url})
        beating = asyncio.create_task(self._daemon.beat(lambda: self._server.counts))
        try:
            await self._daemon.hear(self._take)
        finally:
            beating.cancel()
            await self._server.close()

    async def _take(self, kind: Kind, body: bytes) -> None:
        server = self._server
        match kind:
            case Kind.LAYOUT:
                await server.layout(parse_json(body))
            case Kind.FRAMES:
                await server.row(parse_json(body))
            case Kind.ITEM:
                await self._item(parse_json(body))
            case Kind.HEALTH:
                await server.health(body.decode())
            case _:
                raise ProtocolError(f"the daemon does not say {kind.name}")

    async def _item(self, told: Mapping[str, Any]) -> None:
        kind, body = told["kind"], told["body"]
        if kind == "alarm":
            await self._server.alarm(body)
        elif kind == "energy":
            await self._server.energy(body)
        elif kind == "event" and body["kind"] == ACKNOWLEDGED:
            await self._server.acknowledged(body["data"])

    async def _order(self, alarm: str, name: str, note: str) -> str | None:
        """Have an alarm acknowledged by the daemon; return why not."""
        try:
            await self._daemon.order({"what": "acknowledge", "alarm": alarm, "name": name, "note": note})
        except CellwattError as error:
            return str(error)
        return None


async def serve(daemon: Daemon, settings: Mapping[str, Any]) -> None:
    """Serve what the daemon tells, until it goes."""
    await Serving(daemon, settings).run()


if __name__ == "__main__":
    quiet()
    bound_arrays()
    main(serve, logging.WARNING)
