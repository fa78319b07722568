"""Requests to meters through pymodbus; meters on one line share it."""

from __future__ import annotations

import asyncio
import logging
import os
import termios
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError, DeviceError, ProtocolError

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient

Framing = Literal["tcp", "rtu"]
Parity = Literal["none", "even", "odd"]

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


class NoAnswerError(ConnectError):
    """A request timed out; the connection stands."""


class RefusedError(DeviceError):
    """The meter, or the gateway before it, answered with an exception ``code``."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


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
    """A serial line and how it is set."""

    path: str
    baud: int
    parity: Parity
    stop_bits: int

    def __str__(self) -> str:
        return f"{self.path} ({self.baud} 8{self.parity[0].upper()}{self.stop_bits})"


Place = TcpPlace | SerialPlace


class Bus:
    """An open line. Whoever holds ``turn`` has it alone; ``settle`` s pass after a request nobody answered."""

    def __init__(self, place: Place, client: AsyncModbusTcpClient | AsyncModbusSerialClient, settle: float) -> None:
        self.place = place
        self.turn = asyncio.Lock()
        self.users = 0
        self._client = client
        self._settle = settle

    @property
    def alive(self) -> bool:
        """Whether the connection stands."""
        return bool(self._client.connected)

    async def read(self, function: Literal["input", "holding"], address: int, count: int, unit: int) -> Sequence[int]:
        """Registers ``address`` … of the meter ``unit``.

        Raises ``NoAnswerError``, ``RefusedError``, ``ProtocolError`` where the answer is another meter's, and
        ``ConnectError`` where the connection is gone.
        """
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
        registers: Sequence[int] = answer.registers
        return registers

    async def identification(self, unit: int) -> tuple[str, ...]:
        """What the meter says of itself (function 43, type 14): maker, product, version, as far as it does.

        Raises what ``read`` raises.
        """
        ask = self._client.read_device_information
        answer = await self._exchange(lambda: ask(read_code=1, device_id=unit), unit)
        if answer.isError():
            code = int(answer.exception_code)
            raise RefusedError(f"unit {unit} at {self.place} does not say who it is (exception {code})", code)
        texts = (value.decode("ascii", "replace").strip() for _, value in sorted(answer.information.items()))
        return tuple(text for text in texts if text)

    async def _exchange(self, ask: Callable[[], Awaitable[Any]], unit: int) -> Any:
        from pymodbus.exceptions import ModbusException, ModbusIOException

        client = self._client
        if not client.connected:
            raise ConnectError(f"{self.place}: the connection is gone")
        try:
            answer = await ask()
        except ModbusIOException as error:
            if not client.connected:  # pymodbus closes it after a few requests that nobody answered
                reason = "no answer any more" if "No response" in str(error) else "the connection is gone"
                raise ConnectError(f"unit {unit} at {self.place}: {reason}") from error
            if "received" in str(error) and "No response" not in str(error):
                raise ProtocolError(f"{self.place}: another answer than asked for: {error}") from error
            await asyncio.sleep(self._settle)
            raise NoAnswerError(f"unit {unit} at {self.place} gave no answer") from error
        except ModbusException as error:
            raise ConnectError(f"{self.place}: {error}") from error
        _obey_cancellation()
        return answer

    def close(self) -> None:
        """Let go of the line."""
        self._client.close()


_OPEN: dict[tuple[asyncio.AbstractEventLoop, Place], Bus] = {}
_OPENING: dict[tuple[asyncio.AbstractEventLoop, Place], asyncio.Lock] = {}


@asynccontextmanager
async def open_bus(place: Place, timeout: float) -> AsyncIterator[Bus]:
    """The line at a place, opened where it is not open yet. Raises ``ConnectError`` that says what to check."""
    key = (asyncio.get_running_loop(), place)
    async with _OPENING.setdefault(key, asyncio.Lock()):
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
                _OPENING.pop(key, None)


async def _connect(place: Place, timeout: float) -> Bus:
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it logs what is raised here
    client = _tcp(place, timeout) if isinstance(place, TcpPlace) else _serial(place, timeout)
    try:
        async with asyncio.timeout(timeout):
            connected = await client.connect()
    except TimeoutError:
        connected = False
    except (OSError, ValueError, termios.error) as error:
        client.close()
        raise ConnectError(f"{place} cannot be opened: {error}") from error
    except BaseException:
        client.close()
        raise
    if not connected:
        client.close()
        _obey_cancellation()
        raise ConnectError(_unreachable(place, timeout))
    numbered = isinstance(place, TcpPlace) and place.framing == "tcp"
    # Answers on RTU carry no number: a late one must not be taken for that of the next request.
    return Bus(place, client, 0.0 if numbered else timeout)


def _obey_cancellation() -> None:
    """pymodbus waits by ``asyncio.wait_for``, which up to Python 3.11 forgets a cancellation that meets the answer."""
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError


def _tcp(place: TcpPlace, timeout: float) -> AsyncModbusTcpClient:
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusTcpClient

    framer = FramerType.SOCKET if place.framing == "tcp" else FramerType.RTU
    return AsyncModbusTcpClient(
        place.host, port=place.port, framer=framer, timeout=timeout, retries=0, reconnect_delay=0
    )


def _serial(place: SerialPlace, timeout: float) -> AsyncModbusSerialClient:
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
