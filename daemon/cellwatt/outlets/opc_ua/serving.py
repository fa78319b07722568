"""The process that serves a cell over OPC UA: ``python -m cellwatt.outlets.opc_ua.serving FD``."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

from cellwatt.errors import CellwattError, OutletError
from cellwatt.outlets.apart.daemon import Daemon, main
from cellwatt.outlets.apart.wire import Kind
from cellwatt.outlets.opc_ua.arrays import bound_arrays
from cellwatt.outlets.opc_ua.served import CellServer
from cellwatt.outlets.zenoh.messages import parse_json


async def serve(daemon: Daemon, settings: Mapping[str, Any]) -> None:
    """Serve what the daemon tells, until it goes. Raises ``OutletError`` if that cannot be."""

    async def order(alarm: str, name: str, note: str) -> str | None:
        """Have an alarm acknowledged by the daemon; return why not."""
        try:
            await daemon.order({"what": "acknowledge", "alarm": alarm, "name": name, "note": note})
        except CellwattError as error:
            return str(error)
        return None

    server = CellServer(settings, order)
    takes = {Kind.LAYOUT: server.layout, Kind.FRAMES: server.row, Kind.ITEM: server.item}

    async def take(kind: Kind, body: bytes) -> None:
        if kind is Kind.HEALTH:
            await server.health(body.decode())
        else:
            await takes[kind](parse_json(body))

    try:
        url = await server.open()
    except (OSError, ValueError) as error:
        told = getattr(error, "strerror", None) or str(error)
        raise OutletError(f"the OPC UA server cannot listen or be made: {told}") from error
    try:
        await daemon.serve(url, lambda: server.counts, take)
    finally:
        await server.close()


if __name__ == "__main__":
    logging.getLogger("asyncua").setLevel(logging.ERROR)
    bound_arrays()
    main(serve, logging.WARNING)
