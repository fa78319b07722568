"""Reads over Modbus through pymodbus; devices on one line share its connection.

Errors distinguish a lost connection, a refusal and a timeout.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import termios
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError, why
from cellwatt_drivers.shared.aside import obey_cancellation
from cellwatt_drivers.shared.polling import NoAnswerError
from cellwatt_drivers.shared.serial_port import open_port

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.exceptions import ModbusException

    Client = AsyncModbusTcpClient | AsyncModbusSerialClient

Function = Literal["input", "holding"]
Framing = Literal["tcp", "rtu"]
Parity = Literal["none", "even", "odd"]

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, FAILURE = 1, 2, 3, 4
LATER = frozenset({5, 6, 11})
"""Exceptions after which the same request may succeed: it needs time, it is busy, the gateway got no answer."""
_HEADER = 6
"""Bytes of a frame's header up to and including the length."""
_WORDS = {
    ILLEGAL_FUNCTION: "it does not know the function",
    ILLEGAL_ADDRESS: "it has no such register",
    ILLEGAL_VALUE: "it does not return so many registers",
    FAILURE: "it failed",
    5: "it needs time",
    6: "it is busy",
    10: "the gateway has no path to it",
    11: "the gateway got no answer from it",
}


class RefusedError(DeviceError):
    """The device, or the gateway in front of it, answered with an exception ``code``."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class OtherNumberError(NoAnswerError):
    """An answer with a transaction number that no pending request has: another client's answer, or a faulty gateway."""

    reason = "other transaction number"


class OtherUnitError(OtherNumberError):
    """An answer to the request that names another unit than the requested one."""

    reason = "other unit"


class Numbering:
    """Numbers of Modbus TCP, whose answers pymodbus ignores if wrong; ``trace`` is its ``trace_packet``."""

    def __init__(self) -> None:
        self._unanswered: set[int] = set()
        self._asked = self._unit = 0
        self._ignored: tuple[type[NoAnswerError], str] | None = None
        """Error and text for an answer since the last request that is not its answer."""
        self._rest = b""
        """Start of an answer that is not complete."""

    def trace(self, sending: bool, data: bytes) -> bytes:
        """Record the numbers of sent or received frames; return the frames.

        A gateway may refuse a request in its own name: its exceptions are returned as those of the requested unit.
        """
        if sending:
            self._asked, self._unit, self._ignored = int.from_bytes(data[:2], "big"), data[_HEADER], None
            self._rest = b""
            self._unanswered.add(self._asked)
            return data
        frames, start = bytearray(data), 0
        while (rest := frames[start:]) and len(rest) >= (end := _HEADER + int.from_bytes(rest[4:6], "big")) > _HEADER:
            number, unit = int.from_bytes(rest[:2], "big"), rest[_HEADER]
            if number and number not in self._unanswered:  # pymodbus accepts 0 as the number of any request
                text = f"answers with another transaction number ({number}, asked with {self._asked}): "
                more = "is the gateway faulty, or does it mix up the answers of two clients?"
                self._ignored = OtherNumberError, text + more
            elif number not in (0, self._asked):
                self._ignored = NoAnswerError, "answers too late: write a longer timeout"
            elif unit != self._unit and rest[_HEADER + 1 : end] >= b"\x80":
                frames[start + _HEADER] = self._unit
            elif unit != self._unit:
                self._ignored = OtherUnitError, f"answers as unit {unit}: write unit: {unit}"
            self._unanswered.discard(number or self._asked)
            start += end
        self._rest = bytes(rest)
        return bytes(frames)

    def of(self, unanswered: NoAnswerError) -> NoAnswerError:
        """Return the error that explains why the last request has no answer."""
        if self._ignored is not None:
            kind, text = self._ignored
        elif self._rest:
            start = self._rest[:16].hex(" ")
            kind, text = NoAnswerError, f"sends an answer that is not complete ({start}): is its stated length wrong?"
        else:
            return unanswered
        return kind(f"{str(unanswered).removesuffix('gave no answer')}{text}")


class Checksums(Numbering):
    """Answers on RTU, which have no number: found by their checksum among noise and echoes of the request."""

    _request = bytes(6)
    """The last request; before the first one, all that is received is noise."""

    def trace(self, sending: bool, data: bytes) -> bytes:
        """Record a sent frame; return the answer in what was received since, or nothing if it is not complete."""
        from pymodbus.framer import FramerRTU

        if sending:
            self._request, self._ignored = data, None
            return data
        unit, function = self._request[:2]
        due = 2 * self._request[5]
        echo = len(self._request) if data.startswith(self._request) else 0
        for start in range(echo, len(data) - 4):
            count = data[start + 2] if data[start + 1] == function else 0
            frame = data[start : start + 5 + count]
            if unit not in (0, frame[0]) or frame[1] & 0x7F != function:
                continue
            if len(frame) < 5 + count:
                if count == due:  # an answer that is not complete; its data may look like a shorter one
                    break
            elif not FramerRTU.compute_CRC(frame):
                return frame
        rest = data.removeprefix(self._request)
        text = f"sends no valid answer ({rest[:16].hex(' ')}): check speed, parity and wires"
        self._ignored = (NoAnswerError, text) if rest else None
        return b""


@dataclass(frozen=True, slots=True)
class TcpPlace:
    """The TCP port of a device or gateway; ``advice`` says what to check if it cannot be opened."""

    host: str
    port: int
    framing: Framing
    advice: str

    def __str__(self) -> str:
        return f"TCP {self.host}:{self.port}"


@dataclass(frozen=True, slots=True)
class SerialPlace:
    """A serial line and its settings."""

    path: str
    baud: int
    parity: Parity
    stop_bits: int
    advice: str = "check its settings"

    def __str__(self) -> str:
        return f"{self.path} ({self.baud} 8{self.parity[0].upper()}{self.stop_bits})"


Place = TcpPlace | SerialPlace


class Bus:
    """A line that opens itself for a request; requests are sent within a ``turn``.

    Meters and gateways close connections that rest between two polls: the request opens the line again, also if
    the closing shows only then.
    """

    def __init__(self, place: Place) -> None:
        self.place = place
        self.users = 0
        self.asked = 0
        """Time of the newest request, ns, by ``time.monotonic_ns``."""
        self._numbering = Numbering() if isinstance(place, TcpPlace) and place.framing == "tcp" else Checksums()
        self._client = _client(place, self._numbering)
        self._lock = asyncio.Lock()

    @asynccontextmanager
    async def turn(self, timeout: float) -> AsyncIterator[None]:
        """Use the line alone; each request waits ``timeout`` s at most for its answer."""
        async with self._lock:
            self._timeout = self._client.ctx.comm_params.timeout_connect = timeout
            # Answers on RTU carry no number: a late answer must not be mistaken for that of the next request.
            self._settle = timeout if isinstance(self._numbering, Checksums) else 0.0
            yield

    async def read(self, function: Function, address: int, count: int, unit: int) -> list[int]:
        """Read ``count`` registers of a unit, from ``address`` on.

        Raises ``NoAnswerError``, ``RefusedError``, ``ProtocolError`` if the answer does not match the request, and
        ``ConnectError`` if the line cannot be opened, or the connection is lost.
        """
        client = self._client
        ask = client.read_input_registers if function == "input" else client.read_holding_registers
        who, what = f"unit {unit} at {self.place}", f"registers {address} to {address + count - 1}"
        asked = f"{who}, asked for {what},"
        answer = await self._exchange(lambda: ask(address, count=count, device_id=unit), asked)
        if answer.isError():
            code = int(answer.exception_code)
            text = _WORDS.get(code, "no reason given")
            raise RefusedError(f"{who} refuses {what}: {text} (exception {code})", code)
        registers: list[int] = answer.registers
        if len(registers) != count:
            raise ProtocolError(f"{asked} gives {len(registers)} registers")
        return registers

    async def _exchange(self, ask: Callable[[], Awaitable[Any]], asked: str) -> Any:
        rested = self._client.connected
        try:
            return await self._once(ask, asked)
        except NoAnswerError:
            await asyncio.sleep(self._settle)
            raise
        except ConnectError:
            if not rested:
                raise
        await asyncio.sleep(self._settle)  # a device server may pass the first answer on to the next connection
        return await self._exchange(ask, asked)

    async def _once(self, ask: Callable[[], Awaitable[Any]], asked: str) -> Any:
        from pymodbus.exceptions import ModbusException

        if not self._client.connected:
            await self._open()
        self.asked = time.monotonic_ns()
        try:
            answer = await ask()
        except ModbusException as error:
            obey_cancellation()
            raise self._meaning(error, asked) from error
        obey_cancellation()
        return answer

    def _meaning(self, error: ModbusException, asked: str) -> SourceError:
        from pymodbus.exceptions import ConnectionException, ModbusIOException

        text = str(error)
        if isinstance(error, ModbusIOException) and ("received" not in text or "No response" in text):
            return self._numbering.of(NoAnswerError(f"{asked} gave no answer"))
        if isinstance(error, ConnectionException) or not self._client.connected:
            reason = "closed the connection in place of an answer; does another client use it?"
            return ConnectError(f"{asked} {reason}")
        return ProtocolError(f"{self.place}: the answer does not match the request: {text}")

    async def _open(self) -> None:
        """Open the line. Raises ``ConnectError`` that says what to check."""
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it logs errors raised here, and each invalid frame
        try:
            async with asyncio.timeout(self._timeout):
                opened = await self._client.connect()
        except (TimeoutError, OSError, ValueError, termios.error):
            opened = False
        except BaseException:
            self.close()
            raise
        if not opened:
            self.close()
            obey_cancellation()
            raise ConnectError(await asyncio.to_thread(self._unreachable))

    def _unreachable(self) -> str:
        """Return why the line cannot be opened, which pymodbus does not say."""
        place = self.place
        try:
            if isinstance(place, SerialPlace):
                open_port(place.path, place.baud).close()
            socket.socket().close()
        except ConnectError as error:  # an OSError too
            return str(error)
        except OSError as error:
            return f"no socket can be opened: {why(error)}"
        return f"{place} cannot be opened within {self._timeout:g} s; {place.advice}"

    def close(self) -> None:
        """Close the line."""
        self._client.close()


_LINES: dict[tuple[asyncio.AbstractEventLoop, Place], Bus] = {}
"""The lines in use."""


@asynccontextmanager
async def line(place: Place) -> AsyncIterator[Bus]:
    """Use the line at a place, which all its users share."""
    key = (asyncio.get_running_loop(), place)
    if key not in _LINES:
        _LINES[key] = Bus(place)
    bus = _LINES[key]
    bus.users += 1
    try:
        yield bus
    finally:
        bus.users -= 1
        if not bus.users:
            bus.close()
            del _LINES[key]


def _client(place: Place, numbering: Numbering) -> Client:
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient

    client: Client
    always: dict[str, Any] = {"retries": 0, "reconnect_delay": 0, "trace_packet": numbering.trace}
    if isinstance(place, TcpPlace):
        framer = FramerType.SOCKET if place.framing == "tcp" else FramerType.RTU
        client = AsyncModbusTcpClient(place.host, port=place.port, framer=framer, **always)
    else:
        parity = place.parity[0].upper()
        client = AsyncModbusSerialClient(
            place.path, baudrate=place.baud, parity=parity, stopbits=place.stop_bits, **always
        )
    _fail_at_once(client)
    return client


def _fail_at_once(client: Client) -> None:
    """Let an invalid frame or a closed connection fail the request.

    pymodbus would close the connection, and asyncio print a traceback; or wait for the answer until the timeout.
    """
    from pymodbus.exceptions import ConnectionException, ModbusIOException

    exchanges: Any = client.ctx
    take = exchanges.callback_data

    def fail(error: ModbusException) -> None:
        if not exchanges.response_future.done():
            exchanges.response_future.set_exception(error)
            exchanges.response_future.exception()  # asyncio reports errors that nobody has asked for

    def taken(data: bytes, addr: Any = None) -> int:
        try:
            return int(take(data, addr))
        except ModbusIOException:
            fail(ModbusIOException(f"received {data[:16].hex(' ')}"))
            return len(data)

    exchanges.callback_data = taken
    exchanges.callback_disconnected = lambda exc: fail(ConnectionException("closed"))
