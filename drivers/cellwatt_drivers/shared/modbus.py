"""Reads over Modbus through pymodbus, with errors that tell a lost connection from a refusal and from silence."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError
from cellwatt_drivers.shared.aside import obey_cancellation
from cellwatt_drivers.shared.polling import NoAnswerError

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.exceptions import ModbusException

    Client = AsyncModbusTcpClient | AsyncModbusSerialClient

Function = Literal["input", "holding"]

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
_HEADER = 6
"""Bytes of a frame's header up to its length."""
_WORDS = {
    ILLEGAL_FUNCTION: "it does not know the function",
    ILLEGAL_ADDRESS: "it has no such register",
    ILLEGAL_VALUE: "it does not give so many registers",
    4: "it failed",
    5: "it needs time",
    6: "it is busy",
    10: "the gateway finds no way to it",
    11: "the gateway got no answer from it",
}


class RefusedError(DeviceError):
    """The device, or the gateway before it, answered with an exception ``code``."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class OtherNumberError(NoAnswerError):
    """What came bears a transaction number that was not asked with: another request's answer, or a faulty gateway's."""

    reason = "other transaction number"


class Numbering:
    """Transaction numbers of Modbus TCP, which pymodbus passes over in silence; ``trace`` is its ``trace_packet``."""

    def __init__(self) -> None:
        self._unanswered: set[int] = set()
        self._asked = 0
        self.strange: int | None = None
        """Number of an answer since the last request that no unanswered request bears."""

    def trace(self, sending: bool, data: bytes) -> bytes:
        """Take the frames that are sent, or that came; return them as they are."""
        if sending:
            self._asked, self.strange = int.from_bytes(data[:2], "big"), None
            self._unanswered.add(self._asked)
            return data
        rest = data
        while len(rest) >= _HEADER and len(rest) >= (end := _HEADER + int.from_bytes(rest[4:6], "big")):
            number, rest = int.from_bytes(rest[:2], "big"), rest[end:]
            if number and number not in self._unanswered:  # pymodbus takes 0 for the number asked with
                self.strange = number
            self._unanswered.discard(number or self._asked)
        return data

    def of(self, unanswered: NoAnswerError) -> NoAnswerError:
        """Return the error that says why the last request is unanswered."""
        if self.strange is None:
            return unanswered
        where = str(unanswered).removesuffix(" gave no answer")
        return OtherNumberError(
            f"{where} answers with another transaction number ({self.strange}, asked with {self._asked}): "
            "is the gateway faulty, or does it mix up the answers of two clients?"
        )


class Modbus:
    """Requests over an open connection; ``place`` names it in errors, ``numbering`` follows what passes on it.

    All raise ``NoAnswerError``, ``RefusedError``, ``ProtocolError`` where the answer is another one than asked for,
    and ``ConnectError`` where the connection is gone.
    """

    def __init__(self, client: Client, place: str, numbering: Numbering) -> None:
        self.place = place
        self._client = client
        self._numbering = numbering

    @property
    def alive(self) -> bool:
        """True while the connection stands."""
        return bool(self._client.connected)

    async def read(self, function: Function, address: int, count: int, unit: int) -> list[int]:
        """Return the registers ``address`` … of a unit."""
        client = self._client
        ask = client.read_input_registers if function == "input" else client.read_holding_registers
        answer = await self._exchange(lambda: ask(address, count=count, device_id=unit), unit)
        if answer.isError():
            code = int(answer.exception_code)
            text = _WORDS.get(code, "it does not say why")
            raise RefusedError(
                f"unit {unit} at {self.place} refuses registers {address} to {address + count - 1}: {text} "
                f"(exception {code})",
                code,
            )
        registers: list[int] = answer.registers
        if len(registers) != count:
            raise ProtocolError(f"unit {unit} at {self.place} gives {len(registers)} registers of {count}")
        return registers

    async def _exchange(self, ask: Callable[[], Awaitable[Any]], unit: int) -> Any:
        from pymodbus.exceptions import ModbusException

        if not self.alive:  # the library would open it anew by itself
            raise ConnectError(f"{self.place}: the connection is gone")
        try:
            answer = await ask()
        except ModbusException as error:
            obey_cancellation()
            raise self._meaning(error, unit) from error
        obey_cancellation()
        return answer

    def _meaning(self, error: ModbusException, unit: int) -> SourceError:
        from pymodbus.exceptions import ConnectionException, ModbusIOException

        text = str(error)
        if isinstance(error, ConnectionException) or not self.alive:
            # pymodbus closes it after a few requests that nobody answered
            reason = "no answer any more" if "No response" in text else "the connection is gone"
            return ConnectError(f"unit {unit} at {self.place}: {reason}")
        if isinstance(error, ModbusIOException) and ("received" not in text or "No response" in text):
            return self._numbering.of(NoAnswerError(f"unit {unit} at {self.place} gave no answer"))
        return ProtocolError(f"{self.place}: another answer than asked for: {text}")


def tcp_client(host: str, port: int, timeout: float, numbering: Numbering | None) -> AsyncModbusTcpClient:
    """A client for TCP; without ``numbering`` with frames as on a serial line."""
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusTcpClient

    framer, trace = (FramerType.SOCKET, numbering.trace) if numbering else (FramerType.RTU, None)
    return AsyncModbusTcpClient(
        host, port=port, framer=framer, timeout=timeout, retries=0, reconnect_delay=0, trace_packet=trace
    )


async def connect(client: Client, timeout: float, unreachable: Callable[[], str]) -> None:
    """Connect a client, or close it.

    Raises ``ConnectError`` with the text of ``unreachable`` where that does not succeed within ``timeout`` s; whatever
    else the system raises passes.
    """
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it logs what is raised here, and each strange frame
    try:
        async with asyncio.timeout(timeout):
            opened = await client.connect()
    except TimeoutError:
        opened = False
    except BaseException:
        client.close()
        raise
    if not opened:
        client.close()
        obey_cancellation()
        raise ConnectError(unreachable())
