"""A listening port with limits: connections per peer and in total, and deadlines for requests."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import ipaddress
import logging
import socket
import ssl
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from cellwatt.errors import OutletError, why

log = logging.getLogger(__name__)

BACKLOG: Final = 100
"""Most connections that the kernel queues until they are accepted."""
PAUSE: Final = 0.2
"""Pause, s, after the kernel failed to accept a connection for lack of descriptors or memory."""
_DISPLACED, _REFUSED = "connections displaced", "connections refused"
_LATE, _FAILED = "connections timed out", "connections not accepted"
TURNED_AWAY: Final = (_DISPLACED, _REFUSED, _LATE, _FAILED)
"""Names of the counts of connections that were not served."""
_ABSENT: Final = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)
"""Errors of an address that this PC does not have, like the IPv6 address of localhost where IPv6 is turned off."""
SWEEP: Final = 1.0
"""Time, s, between two checks of the deadlines."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a port: connections in total and per peer; time, s, until the first and until each further request."""

    connections: int = 256
    peer: int = 128
    head: float = 10.0
    idle: float = 75.0


class _Connection:
    def __init__(self, sock: socket.socket, peer: str) -> None:
        self.sock, self.peer = sock, peer
        self.since = time.monotonic()
        """Time at which it was accepted or its last request ended, monotonic s."""
        self.requests = self.busy = 0
        self._ended = False
        self.protocol: asyncio.BaseProtocol | None = None
        self.transport: asyncio.Transport | None = None

    @property
    def open(self) -> bool:
        return not self._ended and self.sock.fileno() != -1

    def end(self) -> None:
        """Disconnect, discarding unsent data; the descriptor is free at the next iteration of the event loop."""
        self._ended = True
        if self.transport is not None:
            self.transport.abort()
        elif self.sock.fileno() != -1:
            with contextlib.suppress(OSError):
                self.sock.shutdown(socket.SHUT_RDWR)  # makes its handshake fail


class Port:
    """Accepts connections for protocols made by ``factory``, within ``limits``; ``counts`` counts refused ones.

    A connection without a request in progress is *idle*. A new connection beyond the limits displaces the oldest idle
    connection of its own peer, or of the peer with most connections; if none is idle, the new one is refused.
    ``serving`` returns whether a protocol is active, in addition to the requests marked by ``busy``.
    """

    def __init__(
        self,
        factory: Callable[[], asyncio.BaseProtocol],
        limits: Limits,
        serving: Callable[[Any], bool] = lambda _: False,
        counts: Counter[str] | None = None,
    ) -> None:
        self.counts: Counter[str] = Counter() if counts is None else counts
        self._factory, self._limits, self._serving = factory, limits, serving
        self._listeners: list[socket.socket] = []
        self._connections: dict[int, _Connection] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, host: str, port: int, context: ssl.SSLContext | None = None) -> int:
        """Begin to listen, for port 0 at a free port; return the port. Raises ``OutletError`` on failure."""
        loop = asyncio.get_running_loop()
        try:
            found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
            absent: OSError | None = None
            for family, *_, address in dict.fromkeys(found):
                try:
                    self._listeners.append(_listener(family, (address[0], port, *address[2:])))
                except OSError as error:
                    if error.errno not in _ABSENT:
                        raise
                    absent = error
                    continue
                port = port or self._listeners[0].getsockname()[1]
            if absent is not None and not self._listeners:
                raise absent
        except OSError as error:
            await self.close()
            if "in use" in why(error).lower():
                raise OutletError(f"{host}:{port} is in use: choose another port in listen") from None
            raise OutletError(f"cannot listen at {host}:{port}: {why(error)}") from None
        for listener in self._listeners:
            self._spawn(self._accept(listener, context))
        self._spawn(self._sweep())
        return port

    async def close(self) -> None:
        """Stop listening and disconnect."""
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for listener in self._listeners:
            listener.close()
        self._listeners.clear()
        for connection in self._connections.values():
            connection.end()

    @contextlib.contextmanager
    def busy(self, transport: asyncio.BaseTransport | None) -> Iterator[None]:
        """Mark a request of a connection as in progress."""
        sock = None if transport is None else transport.get_extra_info("socket")
        connection = None if sock is None else self._connections.get(sock.fileno())
        if connection is None:  # the connection was lost meanwhile
            yield
            return
        connection.busy += 1
        try:
            yield
        finally:
            connection.busy -= 1
            connection.requests += 1
            connection.since = time.monotonic()

    def __len__(self) -> int:
        return sum(connection.open for connection in self._connections.values())

    # inside ---------------------------------------------------------------------------------------

    def _spawn(self, work: Any) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _accept(self, listener: socket.socket, context: ssl.SSLContext | None) -> None:
        loop = asyncio.get_running_loop()
        while True:
            try:
                sock, address = await loop.sock_accept(listener)
            except OSError as error:
                self.counts[_FAILED] += 1
                log.warning("a connection cannot be accepted: %s", why(error))
                await asyncio.sleep(PAUSE)
                continue
            connection = _Connection(sock, peer_of(address[0]))
            if self._make_room(connection.peer):
                self._connections[sock.fileno()] = connection
                self._spawn(self._join(connection, context))
            else:
                self.counts[_REFUSED] += 1
                sock.close()
            await asyncio.sleep(0)  # a burst is accepted no faster than displaced connections close

    async def _join(self, connection: _Connection, context: ssl.SSLContext | None) -> None:
        try:
            connection.transport, connection.protocol = await asyncio.get_running_loop().connect_accepted_socket(
                self._factory,
                connection.sock,
                ssl=context,
                ssl_handshake_timeout=None if context is None else self._limits.head,
            )
        except OSError:  # includes ssl.SSLError and TimeoutError
            self.counts["handshakes failed"] += 1
            connection.sock.close()

    def _make_room(self, peer: str) -> bool:
        """Make room for a connection of a peer, if necessary by displacing one; false if that is impossible."""
        self._connections = {number: one for number, one in self._connections.items() if one.open}
        peers = Counter(one.peer for one in self._connections.values())
        if peers[peer] >= self._limits.peer:
            most = peer
        elif len(self._connections) >= self._limits.connections:
            most = peers.most_common(1)[0][0]
        else:
            return True
        idle = [one for one in self._connections.values() if one.peer == most and not self._works(one)]
        if not idle:
            return False
        self.counts[_DISPLACED] += 1
        min(idle, key=lambda one: one.since).end()
        return True

    def _works(self, connection: _Connection) -> bool:
        return connection.busy > 0 or (connection.protocol is not None and self._serving(connection.protocol))

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP)
            now = time.monotonic()
            for one in list(self._connections.values()):
                if self._works(one):
                    one.since = now
                elif one.open and now - one.since > (self._limits.idle if one.requests else self._limits.head):
                    self.counts[_LATE] += 1
                    one.end()


def peer_of(address: str) -> str:
    """The peer at an address; for IPv6 its /64 network, because a host can use any address in it."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv6Address):
        if found.ipv4_mapped is not None:
            return str(found.ipv4_mapped)
        return str(found if found.is_loopback else ipaddress.ip_network((found, 64), strict=False))
    return address


def _listener(family: int, address: Any) -> socket.socket:
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.setblocking(False)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError:
        listener.close()
        raise
    return listener
