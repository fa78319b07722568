"""Requests to meters through pymodbus; meters on one line share its connection."""

from __future__ import annotations

import asyncio
import os
import termios
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal
from weakref import WeakValueDictionary

from cellwatt.errors import ConnectError
from cellwatt_drivers.shared.modbus import Modbus, Numbering, connect, tcp_client
from cellwatt_drivers.shared.polling import NoAnswerError

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
    """An open line. The holder of ``turn`` uses it alone; it rests ``settle`` s after a request without an answer."""

    def __init__(self, client: Client, place: Place, numbering: Numbering, settle: float) -> None:
        super().__init__(client, str(place), numbering)
        self.turn = asyncio.Lock()
        self.users = 0
        self._client = client
        self._settle = settle

    async def _exchange(self, ask: Callable[[], Awaitable[Any]], unit: int) -> Any:
        try:
            return await super()._exchange(ask, unit)
        except NoAnswerError:
            await asyncio.sleep(self._settle)
            raise

    def close(self) -> None:
        """Close the line."""
        self._client.close()


_OPEN: dict[tuple[asyncio.AbstractEventLoop, Place], Bus] = {}
_OPENING: WeakValueDictionary[tuple[asyncio.AbstractEventLoop, Place], asyncio.Lock] = WeakValueDictionary()
"""Each lock exists as long as the line has a user, or someone waits for it."""


@asynccontextmanager
async def open_bus(place: Place, timeout: float) -> AsyncIterator[Bus]:
    """Use the line at a place; open it first if it is not open. Raises ``ConnectError`` that says what to check."""
    key = (asyncio.get_running_loop(), place)
    opening = _OPENING.setdefault(key, asyncio.Lock())
    async with opening:
        bus = _OPEN.get(key)
        if bus is None or not bus.alive:
            bus = _OPEN[key] = await _connect(place, timeout)
        bus.users += 1
    try:
        yield bus
    finally:
        bus.users -= 1
        if not bus.users:
            bus.close()
            if _OPEN.get(key) is bus:
                del _OPEN[key]


async def _connect(place: Place, timeout: float) -> Bus:
    numbering = Numbering()
    numbered = isinstance(place, TcpPlace) and place.framing == "tcp"
    client = _client(place, timeout, numbering if numbered else None)
    try:
        await connect(client, timeout, lambda: _unreachable(place, timeout))
    except ConnectError:
        raise
    except (OSError, ValueError, termios.error) as error:
        raise ConnectError(f"{place} cannot be opened: {error}") from error
    # Answers on RTU carry no number: a late answer must not be mistaken for that of the next request.
    return Bus(client, place, numbering, 0.0 if numbered else timeout)


def _client(place: Place, timeout: float, numbering: Numbering | None) -> Client:
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
    )


def _unreachable(place: Place, timeout: float) -> str:
    if isinstance(place, TcpPlace):
        return (
            f"{place} cannot be opened within {timeout:g} s; check the address and the cable, that Modbus TCP is "
            "switched on at the meter, and that no other client holds its last connection"
        )
    if not os.path.exists(place.path):  # noqa: PTH110  # a path as given, not as Path would write it
        return f"{place.path}: no such port"
    if not os.access(place.path, os.R_OK | os.W_OK):
        return f"{place.path}: permission denied; add the user to the port's group, usually dialout"
    return f"{place.path} cannot be opened; is it a serial port, and not in use by another program?"
