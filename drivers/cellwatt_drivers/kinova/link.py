"""A Modbus TCP connection to the arm that only reads input registers."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from cellwatt_drivers.shared.modbus import Modbus, Numbering, connect


@dataclass(frozen=True, slots=True)
class Answer:
    """Registers, with the cell's times (ns) at which the request left and they came back."""

    registers: list[int]
    asked: int
    arrival: int


class Link:
    """Reads registers of a Modbus ``unit``; ``now`` gives the cell's time, ns."""

    def __init__(self, modbus: Modbus, unit: int, now: Callable[[], int]) -> None:
        self._modbus = modbus
        self._unit = unit
        self._now = now

    async def read(self, first: int, count: int) -> Answer:
        """Read input registers. Raises as ``Modbus.read``."""
        asked = self._now()
        registers = await self._modbus.read("input", first, count, self._unit)
        return Answer(registers, asked, self._now())


@asynccontextmanager
async def open_link(host: str, port: int, unit: int, timeout: float, now: Callable[[], int]) -> AsyncIterator[Link]:
    """Open a connection. Raises ``ConnectError`` that says what to check."""
    from pymodbus.client import AsyncModbusTcpClient

    numbering = Numbering()
    client = AsyncModbusTcpClient(
        host, port=port, timeout=timeout, retries=0, reconnect_delay=0, trace_packet=numbering.trace
    )
    place = f"TCP {host}:{port}"
    advice = "check the address, and that the arm's Modbus server is on (web application, Configurations, Networks)"
    await connect(client, timeout, lambda: f"nobody answers at {place}; {advice}")
    try:
        yield Link(Modbus(client, place, numbering), unit, now)
    finally:
        client.close()
