"""Requests to meters through pymodbus; meters on one line share its connection."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError
from cellwatt_drivers.shared.modbus import Checksums, Modbus, Numbering, connect, tcp_client
from cellwatt_drivers.shared.polling import NoAnswerError
from cellwatt_drivers.shared.serial_port import open_port

if TYPE_CHECKING:
    from cellwatt_drivers.shared.modbus import Client

Framing = Literal["tcp", "rtu"]
Parity = Literal["none", "even", "odd"]


@dataclass(frozen=True, slots=True)
class TcpPlace:
    """A meter's or gateway's TCP port."""

    host: str
    port: int
    framing: Framing

    def __str__(self) -> str:
        return f"TCP {self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialPlace:
    """A serial line and its settings."""

    path: str
    baud: int
    parity: Parity
    stop_bits: int

    def __str__(self) -> str:
        return f"{self.path} ({self.baud} 8{self.parity[0].upper()}{self.stop_bits})"


Place = TcpPlace | SerialPlace


class Bus(Modbus):
    """A line that opens itself for a request; the holder of ``turn`` uses it alone.

    Meters and gateways close connections that rest between two polls: the request opens the line again, also if
    the closing shows only then.
    """

    def __init__(self, place: Place, timeout: float) -> None:
        numbered = isinstance(place, TcpPlace) and place.framing == "tcp"
        numbering = Numbering() if numbered else Checksums()
        super().__init__(_client(place, timeout, numbering), str(place), numbering)
        self.turn = asyncio.Lock()
        self.users = 0
        self._where = place
        self._timeout = timeout
        # Answers on RTU carry no number: a late answer must not be mistaken for that of the next request.
        self._settle = 0.0 if numbered else timeout

    async def _exchange(self, ask: Callable[[], Awaitable[Any]], unit: int) -> Any:
        rested = self.alive
        if not rested:
            await self._open()
        try:
            return await super()._exchange(ask, unit)
        except NoAnswerError:
            await asyncio.sleep(self._settle)
            raise
        except ConnectError:
            if not rested:
                raise
            await self._open()
            return await super()._exchange(ask, unit)

    async def _open(self) -> None:
        """Open the line. Raises ``ConnectError`` that says what to check."""
        await connect(self._client, self._timeout, lambda: _unreachable(self._where, self._timeout))

    def close(self) -> None:
        """Close the line."""
        self._client.close()


_LINES: dict[tuple[asyncio.AbstractEventLoop, Place], Bus] = {}
"""The lines in use."""


@asynccontextmanager
async def line(place: Place, timeout: float) -> AsyncIterator[Bus]:
    """Use the line at a place, which all its users share."""
    key = (asyncio.get_running_loop(), place)
    if key not in _LINES:
        _LINES[key] = Bus(place, timeout)
    bus = _LINES[key]
    bus.users += 1
    try:
        yield bus
    finally:
        bus.users -= 1
        if not bus.users:
            bus.close()
            del _LINES[key]


def _client(place: Place, timeout: float, numbering: Numbering) -> Client:
    if isinstance(place, TcpPlace):
        return tcp_client(place.host, place.port, timeout, numbering)
    from pymodbus.client import AsyncModbusSerialClient

    return AsyncModbusSerialClient(
        place.path,
        baudrate=place.baud,
        parity=place.parity[0].upper(),
        stopbits=place.stop_bits,
        timeout=timeout,
        retries=0,
        reconnect_delay=0,
        trace_packet=numbering.trace,
    )


def _unreachable(place: Place, timeout: float) -> str:
    if isinstance(place, TcpPlace):
        return (
            f"{place} cannot be opened within {timeout:g} s; check the address and the cable, that Modbus TCP is "
            "switched on at the meter, and that no other client holds its last connection"
        )
    try:
        open_port(place.path, place.baud).close()  # pymodbus does not say why
    except ConnectError as error:
        return str(error)
    return f"{place} cannot be opened with these settings"
