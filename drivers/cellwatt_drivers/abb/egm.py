"""Receives a controller's EGM packets; never sends."""

from __future__ import annotations

import asyncio
import socket
import time
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

from cellwatt.account import Account
from cellwatt.errors import ConnectError, why
from cellwatt.receipt import receive
from cellwatt_drivers.abb.wire import LARGEST
from cellwatt_drivers.shared.datagrams import addresses, datagram_socket

_BUFFER = 1 << 20  # bytes; some seconds of packets while this process is delayed
_MOST = 64  # datagrams read at once
_ALONE = 500_000_000  # ns without a packet after which one from another port of the controller is the robot's

Take = Callable[[list[bytes], int], None]
"""Takes packets in order, and the time, ns, for which the last of them has waited in this PC."""


@asynccontextmanager
async def listening(host: str, bind: str, port: int, account: Account, take: Take) -> AsyncIterator[deque[str]]:
    """Pass packets that ``host`` sends to UDP ``bind``:``port`` to ``take``; other senders' count as ``strangers``.

    Each robot of a controller sends from a port of its own: those of a second one are counted and left out.

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
        listener = _Listener(opened, senders, account, take)
        loop.add_reader(opened, listener.receive)
        try:
            yield listener.strangers
        finally:
            loop.remove_reader(opened)


class _Listener:
    """Receives from ``opened``; see ``listening``."""

    def __init__(self, opened: socket.socket, senders: set[str], account: Account, take: Take) -> None:
        self.strangers = deque[str](maxlen=1)
        self._opened = opened
        self._senders = senders
        self._account = account
        self._take = take
        self._own: Any = None
        self._heard = 0

    def receive(self) -> None:
        """Read what has come; called by the loop."""
        datagrams: list[bytes] = []
        waited = 0
        for _ in range(_MOST):
            try:
                datagram, sender, age = receive(self._opened, LARGEST)
            except (BlockingIOError, InterruptedError):
                break
            except OSError:  # a network error on a socket that never sends: received packets are unaffected
                self._account.count("socket errors")
                break
            if sender[0] not in self._senders:
                self._account.anomaly("strangers")
                self.strangers.append(sender[0])
            elif self._is_own(sender, time.monotonic_ns() - age):
                datagrams.append(datagram)
                waited = age
                self.strangers.clear()
            else:
                self._account.anomaly("packets of a second robot")
        if datagrams:
            self._take(datagrams, waited)

    def _is_own(self, sender: Any, arrival: int) -> bool:
        """False for a second port of the robot's address while the first one sends."""
        if sender != self._own and arrival - self._heard < _ALONE:
            return False
        self._own, self._heard = sender, arrival
        return True
