"""UDP: addresses, and sockets that tell how long each datagram has waited in this PC."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from cellwatt.errors import ConnectError, why
from cellwatt.receipt import stamp_receipts


async def addresses(host: str, port: int | None = None, family: int = 0) -> list[Any]:
    """Addresses of a host, as from ``getaddrinfo``. Raises ``ConnectError`` if its name is unknown."""
    try:
        return await asyncio.get_running_loop().getaddrinfo(host, port, family=family, type=socket.SOCK_DGRAM)
    except OSError as error:
        raise ConnectError(f"the name {host!r} is not known: {why(error)}; write the IP address") from error


@contextmanager
def datagram_socket(family: int) -> Iterator[socket.socket]:
    """A non-blocking UDP socket. Raises ``ConnectError`` if this PC has none left."""
    try:
        opened = socket.socket(family, socket.SOCK_DGRAM)
    except OSError as error:
        raise ConnectError(f"no UDP socket can be opened: {why(error)}") from error
    with opened:
        opened.setblocking(False)
        stamp_receipts(opened)
        yield opened
