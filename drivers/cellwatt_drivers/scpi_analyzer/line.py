"""Lines to and from an analyzer over TCP or a serial port; one query at a time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass

import serial

from cellwatt.errors import ConnectError, ProtocolError, why
from cellwatt_drivers.scpi_analyzer.wire import LONGEST, decode_line
from cellwatt_drivers.shared.aside import opened_aside
from cellwatt_drivers.shared.mailbox import Mailbox
from cellwatt_drivers.shared.polling import NoAnswerError
from cellwatt_drivers.shared.serial_port import open_port

_MOST_LINES = 16
_CLOSING = 1.0
"""Longest wait for a connection to close, s; after it the connection closes in the background."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One line with the cell's times (ns) of its query and of its arrival."""

    text: str
    asked: int
    arrival: int


class Line(asyncio.Protocol):
    """The text side of an open connection; its opener sets ``write``; ``closed`` is set once it is closed.

    ``now`` returns the cell's time, ns. Over-long lines and too many unread lines end the conversation, so that memory
    is bounded.
    """

    def __init__(self, place: str, now: Callable[[], int]) -> None:
        self.place = place
        self.write: Callable[[bytes], object] = lambda _: None
        self._now = now
        self._partial = b""
        self._lines: Mailbox[tuple[bytes, int]] = Mailbox(_MOST_LINES)
        self.closed = asyncio.Event()

    def tell(self, command: str) -> None:
        """Send a command without an answer. Raises ``ConnectError``."""
        try:
            self.write(command.encode("ascii") + b"\n")
        except OSError as error:
            raise ConnectError(f"{self.place}: {error.strerror or error}") from error

    async def ask(self, query: str, timeout: float) -> Answer:
        """Send a query and return its answer.

        Raises ``NoAnswerError``, ``ConnectError`` if the connection is lost, and ``ProtocolError`` if the answer is not
        text or unrequested data came before the query: later answers would then be shifted.
        """
        if self._partial or len(self._lines):
            raise ProtocolError(f"{self.place} sent unrequested data")
        asked = self._now()
        self.tell(query)
        text, arrival = await self.read(timeout)
        if text == query:
            raise ProtocolError(f"{self.place} sends back what it receives: switch its echo off")
        return Answer(text, asked, arrival)

    async def read(self, timeout: float) -> tuple[str, int]:
        """Return the next line and its arrival, ns of the cell's time. Raises the same as ``ask``."""
        found = await self._lines.given(timeout, 1)
        if not found:
            raise NoAnswerError(f"{self.place} gave no answer within {round(timeout, 1 if timeout > 1 else 2):g} s")
        data, arrival = found[0]
        return decode_line(data), arrival

    def data_received(self, data: bytes) -> None:
        """Split received data into lines; called by the loop."""
        arrival = self._now()
        *lines, self._partial = (self._partial + data).replace(b"\r", b"\n").split(b"\n")
        for line in filter(None, lines):
            self._lines.take((line, arrival))
        if len(self._partial) > LONGEST or self._lines.dropped:
            self._lines.fail(ConnectError(f"{self.place} floods the line with unrequested data"))
            self._partial = b""

    def connection_lost(self, exc: Exception | None) -> None:
        """Mark the connection as lost; called by the loop."""
        why = getattr(exc, "strerror", None) or exc or "closed by the analyzer"
        self._lines.fail(ConnectError(f"{self.place}: the connection is gone ({why})"))
        self.closed.set()


@asynccontextmanager
async def open_tcp(host: str, port: int, timeout: float, now: Callable[[], int]) -> AsyncIterator[Line]:
    """Open a line over a raw TCP socket. Raises ``ConnectError`` that says what to check."""
    line = Line(f"{host}:{port}", now)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(timeout):
            transport, _ = await loop.create_connection(lambda: line, host, port)
    except TimeoutError as error:
        raise ConnectError(
            f"no device answers at TCP {line.place} within {timeout:g} s; check the address, the cable, and that the "
            "analyzer's LAN interface is selected"
        ) from error
    except OSError as error:
        raise ConnectError(f"TCP {line.place} cannot be opened: {why(error)}") from error
    line.write = transport.write
    try:
        yield line
    finally:
        await _close(transport, line)


@asynccontextmanager
async def open_serial(path: str, baud: int, now: Callable[[], int]) -> AsyncIterator[Line]:
    """Open a line over a serial port, exclusively. Raises ``ConnectError``."""
    line = Line(path, now)
    async with opened_aside(lambda: open_port(path, baud), serial.Serial.close) as device:
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(lambda: line, device)
        line.write = device.write
        try:
            yield line
        finally:
            await _close(transport, line)


async def _close(transport: asyncio.BaseTransport, line: Line) -> None:
    """Close, and wait until pending commands are sent and the port is free again."""
    transport.close()
    with suppress(TimeoutError):
        async with asyncio.timeout(_CLOSING):
            await line.closed.wait()
