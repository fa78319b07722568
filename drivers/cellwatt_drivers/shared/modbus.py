"""Reads over Modbus through pymodbus, with errors that tell a lost connection from a refusal and from silence."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError
from cellwatt_drivers.shared.polling import NoAnswerError

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.exceptions import ModbusException

    Client = AsyncModbusTcpClient | AsyncModbusSerialClient

Function = Literal["input", "holding"]

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
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


class Modbus:
    """Requests over an open connection; ``place`` names it in errors.

    All raise ``NoAnswerError``, ``RefusedError``, ``ProtocolError`` where the answer is another one than asked for,
    and ``ConnectError`` where the connection is gone.
    """

    def __init__(self, client: Client, place: str) -> None:
        self.place = place
        self._client = client

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

    async def identification(self, unit: int) -> tuple[str, ...]:
        """Return what a unit says of itself (function 43, type 14): maker, product and version, as far as it does."""
        ask = self._client.read_device_information
        answer = await self._exchange(lambda: ask(read_code=1, device_id=unit), unit)
        if answer.isError():
            code = int(answer.exception_code)
            raise RefusedError(f"unit {unit} at {self.place} does not say who it is (exception {code})", code)
        texts = (value.decode("ascii", "replace").strip() for _, value in sorted(answer.information.items()))
        return tuple(text for text in texts if text)

    async def _exchange(self, ask: Callable[[], Awaitable[Any]], unit: int) -> Any:
        from pymodbus.exceptions import ModbusException

        if not self.alive:  # the library would open it anew by itself
            raise ConnectError(f"{self.place}: the connection is gone")
        try:
            answer = await ask()
        except ModbusException as error:
            _obey_cancellation()
            raise self._meaning(error, unit) from error
        _obey_cancellation()
        return answer

    def _meaning(self, error: ModbusException, unit: int) -> SourceError:
        from pymodbus.exceptions import ConnectionException, ModbusIOException

        text = str(error)
        if isinstance(error, ConnectionException) or not self.alive:
            # pymodbus closes it after a few requests that nobody answered
            reason = "no answer any more" if "No response" in text else "the connection is gone"
            return ConnectError(f"unit {unit} at {self.place}: {reason}")
        if isinstance(error, ModbusIOException) and ("received" not in text or "No response" in text):
            return NoAnswerError(f"unit {unit} at {self.place} gave no answer")
        return ProtocolError(f"{self.place}: another answer than asked for: {text}")


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
        _obey_cancellation()
        raise ConnectError(unreachable())


def _obey_cancellation() -> None:
    """pymodbus waits by ``asyncio.wait_for``, which up to Python 3.11 forgets a cancellation that meets the answer."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
