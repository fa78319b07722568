"""A Modbus TCP connection to the arm that only reads input registers."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cellwatt.errors import ConnectError, DeviceError, ProtocolError

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusTcpClient

_EXCEPTIONS = {
    1: "it does not know the request",
    2: "it has no such registers",
    3: "it refuses the number of registers",
    4: "it failed",
    6: "it is busy",
}


class LateError(ConnectError):
    """No answer in time; the connection must be opened anew, so that a late one is not taken for another's."""


@dataclass(frozen=True, slots=True)
class Answer:
    """Registers, with the cell's times (ns) at which the request left and they came back."""

    registers: list[int]
    asked: int
    arrival: int


class Link:
    """Reads over an open connection; waits ``timeout`` s for each answer. ``now`` gives the cell's time, ns."""

    def __init__(
        self, client: AsyncModbusTcpClient, place: str, unit: int, timeout: float, now: Callable[[], int]
    ) -> None:
        self.place = place
        self._client = client
        self._unit = unit
        self._timeout = timeout
        self._now = now

    async def read(self, first: int, count: int) -> Answer:
        """Input registers. Raises ``LateError``, ``ConnectError``, ``DeviceError`` or ``ProtocolError``."""
        from pymodbus.exceptions import ConnectionException, ModbusException, ModbusIOException

        if not self._client.connected:  # the library would open it anew by itself, and log that
            raise ConnectError(f"{self.place}: the connection is gone")
        asked = self._now()
        try:
            answer = await self._client.read_input_registers(first, count=count, device_id=self._unit)
        except ConnectionException as error:
            _obey_cancellation()
            raise ConnectError(f"{self.place}: the connection is gone") from error
        except ModbusIOException as error:
            _obey_cancellation()
            if not self._client.connected:
                raise ConnectError(f"{self.place}: the connection is gone") from error
            raise LateError(f"{self.place} gave no answer within {self._timeout:g} s") from error
        except ModbusException as error:
            raise ProtocolError(f"{self.place}: an answer that is not understood: {error}") from error
        _obey_cancellation()
        arrival = self._now()
        if answer.isError():
            code = getattr(answer, "exception_code", 0)
            said = _EXCEPTIONS.get(code, "see the Modbus specification")
            raise DeviceError(
                f"{self.place} answers registers {first} to {first + count - 1} with error {code}: {said}"
            )
        if len(answer.registers) != count:
            raise ProtocolError(f"{self.place} gives {len(answer.registers)} registers of {count}")
        return Answer(list(answer.registers), asked, arrival)


def _obey_cancellation() -> None:
    """pymodbus waits by ``asyncio.wait_for``, which up to Python 3.11 forgets a cancellation that meets the answer."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


@asynccontextmanager
async def open_link(host: str, port: int, unit: int, timeout: float, now: Callable[[], int]) -> AsyncIterator[Link]:
    """A connection. Raises ``ConnectError`` that says what to check."""
    from pymodbus.client import AsyncModbusTcpClient

    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it logs what is raised here, and each strange frame
    client = AsyncModbusTcpClient(host, port=port, timeout=timeout, retries=0, reconnect_delay=0)
    place = f"{host}:{port}"
    try:
        connected = await client.connect()
        _obey_cancellation()
        if not connected:
            raise ConnectError(
                f"nobody answers at TCP {place}; check the address, and that the arm's Modbus server is on "
                "(web application, Configurations, Networks)"
            )
        yield Link(client, place, unit, timeout, now)
    finally:
        client.close()
