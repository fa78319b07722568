"""Receives a controller's EGM packets; never sends."""

from __future__ import annotations

import asyncio
import socket
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from cellwatt.account import Account
from cellwatt.errors import ConnectError, why
from cellwatt.receipt import receive
from cellwatt_drivers.abb.wire import LARGEST
from cellwatt_drivers.shared.datagrams import addresses, datagram_socket

_BUFFER = 1 << 20  # bytes; some seconds of packets while this process is delayed
_MOST = 64  # datagrams read at once

Take = Callable[[list[bytes], int], None]
"""Takes packets in order, and the time, ns, for which the last of them has waited in this PC."""


@asynccontextmanager
async def listening(host: str, bind: str, port: int, account: Account, take: Take) -> AsyncIterator[deque[str]]:
    """Pass packets that ``host`` sends to UDP ``bind``:``port`` to ``take``; other senders' count as ``strangers``.

    Yields the newest address of the latter, as long as the former sends nothing.
    Raises ``ConnectError`` if the port is in use or the host's name is unknown.
    """
    loop = asyncio.get_running_loop()
    senders = {str(entry[4][0]) for entry in await addresses(host, family=socket.AF_INET)}
    with datagram_socket(socket.AF_INET) as opened:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        try:
            opened.bind((bind, port))
        except OSError as error:
            raise ConnectError(
                f"UDP port {port} of {bind} cannot be opened for EGM: {why(error)}; another program, or another source "
                "of this cell, may use it: give each robot its own egm_port"
            ) from error
        strangers = deque[str](maxlen=1)
        loop.add_reader(opened, _receive, opened, senders, strangers, account, take)
        try:
            yield strangers
        finally:
            loop.remove_reader(opened)


def _receive(opened: socket.socket, senders: set[str], strangers: deque[str], account: Account, take: Take) -> None:
    datagrams: list[bytes] = []
    waited = 0
    for _ in range(_MOST):
        try:
            datagram, sender, age = receive(opened, LARGEST)
        except (BlockingIOError, InterruptedError):
            break
        except OSError:  # a network error on a socket that never sends: received packets are unaffected
            account.count("socket errors")
            break
        if sender[0] in senders:
            datagrams.append(datagram)
            waited = age
            strangers.clear()
        else:
            account.anomaly("strangers")
            strangers.append(sender[0])
    if datagrams:
        take(datagrams, waited)
