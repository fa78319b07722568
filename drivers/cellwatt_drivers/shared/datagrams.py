"""UDP sockets that tell how long each datagram has waited in this PC."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from cellwatt.errors import ConnectError, why
from cellwatt.receipt import stamp_receipts


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
