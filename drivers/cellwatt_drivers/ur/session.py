"""The asyncio client: one connection to a controller."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import NoReturn

from cellwatt.account import Account
from cellwatt.arrays import Float
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError, WrongDeviceError, why
from cellwatt.gather import next_moment
from cellwatt.receipt import receive_into, stamp_receipts
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.fields import FIELDS
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Decoder, Selection
from cellwatt_drivers.ur.wire import ControllerVersion, Kind, TextMessage

BUFFER = 1 << 18
"""Most bytes read from the socket in one pass of the loop."""
AT_ONCE = 128
"""Most packages and other frames handled in one turn of the loop, so that other sources get their turn."""
SOCKET_BUFFER = 1 << 20
"""Receive buffer, bytes, requested from the kernel for late loops (it may grant less, see net.core.rmem_max)."""
TICK = 0.1
"""Time between checks for a silent stream, s."""


Take = Callable[[Float, Float, int | None, int], None]
"""Takes the next packages; see ``Intake.take``."""


class Session:
    """Frames in and out of one connection, ``opened``, which is read each ``gather`` s, or on arrival if 0.

    The kernel stamps received data, so that the arrival time does not depend on the time of reading. ``where`` names
    the connection in errors; ``now`` returns the cell's time, ns.

    With ``decoder`` and ``take`` set, data packages go to ``take`` as they are read, those of one gather interval
    together; while more than ``AT_ONCE`` wait, reading pauses. Text messages of the controller go to ``say``.
    ``closed`` is done when the connection is closed, with the error.
    """

    def __init__(
        self, opened: socket.socket, where: str, now: Callable[[], int], account: Account, gather: Callable[[], float]
    ) -> None:
        self.where = where
        self.decoder: Decoder | None = None
        self.take: Take | None = None
        self.say: Callable[[TextMessage], None] | None = None
        self._loop = asyncio.get_running_loop()
        self.closed: asyncio.Future[None] = self._loop.create_future()
        self._socket = opened
        self._now = now
        self._account = account
        # Without the kernel's stamps, only immediate reading gives the arrival time.
        self._gather = gather if stamp_receipts(opened) else lambda: 0.0
        self._timer: asyncio.TimerHandle | None = None
        self._view = memoryview(bytearray(BUFFER))
        self._filled = 0
        self._arrival = 0  # arrival of the newest bytes, ns
        self._asked: Kind | None = None  # kind of the pending request
        self._answer: asyncio.Future[bytes] | None = None
        self._not_before: int | None = None
        self._resume()

    def _pause(self) -> None:
        """Stop reading until ``_resume``."""
        self._loop.remove_reader(self._socket)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _resume(self) -> None:
        """Read from the next gather time on."""
        if self.closed.done():
            return
        if gather := self._gather():
            self._timer = self._loop.call_at(next_moment(gather), self._read)
        else:
            self._loop.add_reader(self._socket, self._read)

    def _read(self) -> None:
        if self._timer is not None:
            self._resume()
        try:
            # There is always room: every frame is shorter than the buffer.
            size, waited = receive_into(self._socket, self._view[self._filled :])
        except (BlockingIOError, InterruptedError):
            return
        except OSError as error:
            self._end(self._broke(error))
            return
        if size:
            self._received(size, waited)
            return
        if self._filled:
            self._account.anomaly("half frame")
        self._end(ConnectError(f"{self.where}: the controller closed the connection"))

    def _received(self, size: int, waited: int) -> None:
        """Handle complete frames after ``size`` bytes were read that have waited for ``waited`` ns; retain the rest."""
        self._arrival = max(self._arrival, self._now() - waited)  # the last is late by a pause since it was read
        self._filled += size
        if self._take():
            self._pause()
            self._loop.call_soon(self._go_on)

    def _go_on(self) -> None:
        """Handle more of the bytes already read; then resume reading."""
        if self.closed.done():
            return
        if self._take():
            self._loop.call_soon(self._go_on)
        else:
            self._resume()

    def _take(self) -> bool:
        """Handle complete frames in the buffer; true if ``AT_ONCE`` were handled and more may wait."""
        used = handled = 0
        package = self.decoder.package if self.decoder else None
        try:
            for item, end in wire.scan(self._view[: self._filled], wire.FROM_CONTROLLER, package, AT_ONCE):
                if isinstance(item, wire.Run):
                    self._packages(item)
                    handled += item.count
                else:
                    self._frame(item)
                    handled += 1
                used = end
                if handled >= AT_ONCE:
                    break
        except ProtocolError as error:
            self._account.anomaly("protocol error")
            self._end(ProtocolError(f"{self.where}: {error}"))
            return False
        rest = self._filled - used
        if rest and used:
            self._view[:rest] = self._view[used : self._filled]
        self._filled = rest
        return handled >= AT_ONCE and not self.closed.done()

    def _packages(self, run: wire.Run) -> None:
        assert self.decoder is not None and self.take is not None
        if self._asked == Kind.START and self._answer is not None and not self._answer.done():
            self._answer.set_result(wire.ACCEPTED)  # sending has begun, whether or not the controller confirms it
        not_before, self._not_before = self._not_before, None
        controller_time, values = self.decoder.decode(run.data, run.count)
        self.take(controller_time, values, not_before, self._arrival)

    def _frame(self, frame: wire.Frame) -> None:
        if frame.kind == Kind.TEXT_MESSAGE:
            if self.say is not None:  # before the version is agreed, a message may have another format
                self.say(wire.parse_text(frame.payload))
            return
        if self._asked is None or frame.kind != self._asked:
            raise ProtocolError(f"answer {frame.kind.name} without a request")
        self._asked = None
        if self._answer is not None and not self._answer.done():
            self._answer.set_result(frame.payload)
        self._answer = None

    async def ask(self, question: bytes, timeout: float) -> bytes:
        """Send a request; return its answer's payload, within ``timeout`` s. One at a time. Raises ``SourceError``."""
        if self.closed.done():
            self.closed.result()
        if self._asked is not None:
            raise ConnectError(f"{self.where}: not connected")
        answer: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        kind = self._asked = Kind(question[2])
        self._answer = answer
        if question == wire.START:
            self._not_before = self._now()  # the controller makes no package for a connection before this request
        self._send(question)
        try:
            async with asyncio.timeout(timeout):
                return await answer
        except TimeoutError as error:
            asked = kind.name.lower().replace("_", " ")
            raise ConnectError(
                f"{self.where}: connected, but RTDE does not answer within {timeout:g} s ({asked})"
            ) from error

    def _send(self, data: bytes) -> None:
        """Send a few bytes: those that the kernel does not accept at once break the connection."""
        try:
            if self._socket.send(data) < len(data):
                raise BlockingIOError("the other side does not take what is sent")
        except OSError as error:
            self._end(self._broke(error))

    def _broke(self, reason: object) -> ConnectError:
        return ConnectError(f"{self.where}: the connection broke: {reason}")

    def _end(self, error: SourceError) -> None:
        """Close the connection; the pending request and ``closed`` fail."""
        if self.closed.done():
            return
        self._pause()
        self._socket.close()
        for waiting in (self._answer, self.closed):
            if waiting is not None and not waiting.done():
                waiting.set_exception(error)
                waiting.exception()  # mark the exception as retrieved: the waiting task may have been cancelled
        self._answer = None

    def leave(self) -> None:
        """Ask the controller to stop sending."""
        if not self.closed.done():
            self._send(wire.PAUSE)

    def close(self) -> None:
        """Drop the connection at once."""
        self._end(self._broke("it was left"))


@asynccontextmanager
async def connect(
    host: str,
    port: int,
    timeout: float,
    now: Callable[[], int],
    account: Account,
    gather: Callable[[], float] = lambda: 0.0,
) -> AsyncIterator[tuple[Session, ControllerVersion]]:
    """Open a connection with protocol version 2, read each ``gather()`` s; yields it and the controller's version.

    Raises ``ConnectError`` if no device answers within ``timeout`` s, ``WrongDeviceError`` if the device does not speak
    RTDE, ``DeviceError`` if the controller is too old.
    """
    where = f"{host}:{port}"
    try:
        async with asyncio.timeout(timeout):
            session = Session(await _socket(host, port), where, now, account, gather)
    except TimeoutError as error:
        raise ConnectError(
            f"{where}: no answer within {timeout:g} s; is the address right and the robot on?"
        ) from error
    except OSError as error:
        raise ConnectError(f"{where}: {why(error)}; is the robot on and RTDE enabled?") from error
    try:
        yield session, await _greet(session, timeout)
    except asyncio.CancelledError:
        session.leave()
        raise
    finally:
        session.close()


async def _socket(host: str, port: int) -> socket.socket:
    """A connected socket with a large receive buffer (set before connecting, or the window stays small)."""
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    for i, (family, kind, protocol, _, address) in enumerate(found):
        raw = socket.socket(family, kind, protocol)
        try:
            raw.setblocking(False)
            raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, SOCKET_BUFFER)
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            await loop.sock_connect(raw, address)
            return raw
        except BaseException as error:
            raw.close()
            if not isinstance(error, OSError) or i == len(found) - 1:
                raise
    raise OSError(f"no address for {host}")


async def _greet(session: Session, timeout: float) -> ControllerVersion:
    try:
        accepted = wire.parse_accept(await session.ask(wire.ASK_PROTOCOL, timeout))
    except ProtocolError as error:
        raise WrongDeviceError(f"{error}; the server at this port does not speak RTDE") from error
    if not accepted:
        raise DeviceError(f"{session.where}: the controller refuses RTDE protocol version 2; update PolyScope")
    return wire.parse_controller(await session.ask(wire.ASK_CONTROLLER, timeout))


async def begin(
    session: Session, version: ControllerVersion, selection: Selection, rate: float, take: Take, timeout: float
) -> None:
    """Set up the recipe and start it. Raises ``SourceError``."""
    question = wire.ask_outputs(rate, selection.names)
    recipe, types = wire.parse_recipe(await session.ask(question, timeout))
    unknown = [n for n, t in zip(selection.names, types, strict=False) if t == wire.NOT_FOUND]
    if unknown:
        wanted = ", ".join(f"{n} (needs {FIELDS[n].needs})" for n in unknown)
        raise DeviceError(f"{session.where}: PolyScope {version} does not have {wanted}; remove it from channels")
    try:
        session.decoder = Decoder(selection, recipe, types)
    except ProtocolError as error:
        raise ProtocolError(f"{session.where}: {error}") from error
    session.take = take
    if not wire.parse_accept(await session.ask(wire.START, timeout)):
        raise DeviceError(f"{session.where}: the controller refuses to start sending")


async def attend(session: Session, intake: Intake, timeout: float) -> NoReturn:
    """Watch for silence until the connection ends (``SourceError``)."""
    while True:
        await asyncio.wait({session.closed}, timeout=TICK)
        if session.closed.done():
            session.closed.result()
        if intake.watch(timeout):
            raise ConnectError(f"{session.where}: connected, but no data for {timeout:g} s")
