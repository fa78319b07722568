"""The socket of a connection, read in blocks."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable

from cellwatt.gather import next_moment
from cellwatt.receipt import receive_into, stamp_receipts


class GatheringTransport(asyncio.Transport):
    """A connected TCP socket that is read each ``gather`` s, or whenever data arrive if that is 0.

    The kernel stamps received data, so that the arrival time does not depend on the time of reading. Writes must be
    small: data that the kernel does not accept at once breaks the connection.
    """

    def __init__(self, opened: socket.socket, session: asyncio.BufferedProtocol, gather: Callable[[], float]) -> None:
        super().__init__()
        self.waited = 0
        """Time, ns, for which the newest bytes have waited in this PC."""
        self._socket = opened
        self._session = session
        self._loop = asyncio.get_running_loop()
        # Without the kernel's stamps, only immediate reading gives the arrival time.
        self._gather = gather if stamp_receipts(opened) else lambda: 0.0
        self._timer: asyncio.TimerHandle | None = None
        session.connection_made(self)
        self.resume_reading()

    def pause_reading(self) -> None:
        """Stop reading until ``resume_reading``."""
        self._loop.remove_reader(self._socket)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def resume_reading(self) -> None:
        """Read from the next gather time on."""
        if self.is_closing():
            return
        if gather := self._gather():
            self._timer = self._loop.call_at(next_moment(gather), self._read)
        else:
            self._loop.add_reader(self._socket, self._read)

    def _read(self) -> None:
        if self._timer is not None:
            self.resume_reading()
        room = memoryview(self._session.get_buffer(-1))
        try:
            size, self.waited = receive_into(self._socket, room)
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._end(error)
            return
        if not size:
            self._session.eof_received()
            self._end(None)
            return
        self._session.buffer_updated(size)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send a few bytes now."""
        try:
            if not self.is_closing() and self._socket.send(data) < len(data):
                raise BlockingIOError("the other side does not take what is sent")
        except OSError as error:
            self._end(error)

    def is_closing(self) -> bool:
        """True once the socket is closed."""
        return self._socket.fileno() < 0

    def close(self) -> None:
        """Close the connection."""
        self._end(None)

    abort = close

    def _end(self, error: Exception | None) -> None:
        if not self.is_closing():
            self.pause_reading()
            self._socket.close()
            self._loop.call_soon(self._session.connection_lost, error)
