"""The asyncio side of the power board: listen, decode, emit."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field, StrictInt

from cellwatt import (
    ConnectError,
    Driver,
    Identity,
    Inlet,
    ProtocolError,
    SourceError,
    SourceSettings,
    Stream,
    WrongDeviceError,
)
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.power_board import wire
from cellwatt_drivers.power_board.board import Board, board_stream
from cellwatt_drivers.power_board.payload import Packet
from cellwatt_drivers.power_board.port import ListeningPort, listening_port
from cellwatt_drivers.shared.choice import Chosen, SerialPath

EVIDENCE = 4096
"""Newest bytes retained for a diagnosis until a wanted packet is received."""

_GARBLED = frozenset({"checksum", "garbage bytes", "foreign payloads"})
BoardNumber = Annotated[StrictInt, Field(ge=0, le=255)]


def _listed(value: object) -> object:
    return [value] if isinstance(value, int) else value


class PowerBoardSettings(SourceSettings):
    """A power-measuring board behind an XBee/ZigBee receiver on a serial port."""

    reached_by: ClassVar[tuple[str, ...]] = ("port",)

    port: SerialPath
    """Device path; prefer /dev/serial/by-id/…, which stays the same when the adapter is plugged in elsewhere."""
    baud: StrictInt = Field(115200, ge=1200, le=4_000_000)
    """Speed of the serial line, as set in the receiver (BD)."""
    mode: wire.Mode = "api"
    """Mode of the receiver: api (AP=1), api_escaped (AP=2) or transparent (AP=0)."""
    boards: Annotated[Chosen[BoardNumber] | None, BeforeValidator(_listed)] = None
    """Number of the board, or a list of numbers; omitted: the first board received."""
    phases: StrictInt = Field(3, ge=1, le=3)
    """Phases that the board measures."""
    rate: Hertz = 123.0
    """Nominal samples per second; the board's clock and counter give the actual rate."""
    reorder: Seconds = Field(0.04, ge=0, le=10)
    """Longest wait of a sample for one that it overtook; later ones are counted as late."""
    silence: Seconds = Field(5.0, gt=0)
    """Time without a valid sample after which the port is closed and opened again."""


class PowerBoardDriver(Driver[PowerBoardSettings]):
    """Listens to one or several power boards on one serial port; never writes to it.

    The state of each board outlives the connection, so that after a port has disappeared and returned, the board's own
    numbering still gives the exact number of lost samples.
    """

    Settings = PowerBoardSettings
    title = "Serial power-measuring board behind an XBee/ZigBee receiver"
    emulator = "cellwatt_drivers.power_board.emulator:PowerBoardEmulator"
    writes: ClassVar[tuple[str, ...]] = ()
    least_delay: ClassVar[tuple[float, float]] = (0.0, 0.03)  # board → radio → receiver → USB: see the docs page

    def __init__(self, name: str, settings: PowerBoardSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        self._boards = {n: self._board(n, s) for n, s in zip(settings.boards or (), self.streams, strict=False)}

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream per board; named ``power`` if there is only one."""
        s = self.settings
        if s.boards is None or len(s.boards) == 1:
            return (board_stream(s.phases, s.rate),)
        return tuple(board_stream(s.phases, s.rate, board) for board in s.boards)

    async def run(self) -> None:
        """See ``Driver.run``."""
        async with listening_port(self.settings.port, self.settings.baud) as port:
            listening = self._listening(port)
            opened, connected = self.inlet.now(), False
            try:
                while True:
                    received = await listening.packets(self._wait())
                    if received and not connected:
                        connected = True
                        self.inlet.connected(_identity(received[0][0], port))
                    self._deliver(received, opened)
            finally:
                for board in self._boards.values():
                    board.release(self.inlet.now(), everything=True)

    async def identify(self) -> Identity:
        """See ``Driver.identify``; every packet contains the board's number."""
        async with listening_port(self.settings.port, self.settings.baud) as port:
            listening = self._listening(port)
            while not (received := await listening.packets(self.settings.silence)):
                pass
            return _identity(received[0][0], port)

    def _deliver(self, received: list[tuple[Packet, int]], opened: int) -> None:
        for packet, arrival in received:
            if packet.board not in self._boards:
                self._boards[packet.board] = self._board(packet.board, self.streams[0])
            self._boards[packet.board].take(packet, arrival)
        now = received[-1][1] if received else self.inlet.now()
        for board in self._boards.values():
            board.release(now)
            if len(self._boards) > 1:  # a lone board's silence ends ``run``
                board.watch(now, opened, round(self.settings.silence * 1e9))

    def _board(self, number: int, stream: Stream) -> Board:
        s = self.settings
        return Board(f"{self.name}: board {number}", stream, s.phases, round(s.reorder * 1e9), self.inlet)

    def _listening(self, port: ListeningPort) -> Listening:
        return Listening(port, self.settings, tuple(self._boards), self.inlet, self.gather)

    def _wait(self) -> float:
        """Time, s, until a board skips a gap."""
        deadlines = [at for b in self._boards.values() if (at := b.order.deadline) is not None]
        return max(0.0, (min(deadlines) - self.inlet.now()) / 1e9) if deadlines else self.settings.silence


def _identity(packet: Packet, port: ListeningPort) -> Identity:
    notes = {"payload": f"{packet.phases} phases, {packet.samples} samples a packet"}
    if port.latency is not None and port.latency > 1:
        notes["latency timer"] = (
            f"the adapter holds bytes for {port.latency} ms, which blurs the clock model: "
            "set its latency_timer to 1 (docs/drivers/power_board.md)"
        )
    return Identity(maker="", model=f"power board {packet.board}", serial=str(packet.board), notes=notes)


class Listening:
    """From an open port to packets of wanted boards, read each ``gather()`` s; all other data is counted.

    ``boards`` may be empty: then the first board received is the wanted one.
    """

    def __init__(
        self,
        port: ListeningPort,
        settings: PowerBoardSettings,
        boards: tuple[int, ...],
        inlet: Inlet,
        gather: Callable[[], float],
    ) -> None:
        self._port = port
        self._settings = settings
        self._wanted = boards
        self._account = inlet.account
        self._now = inlet.now
        self._gather = gather
        self._decoder = wire.decoder(settings.mode)
        self._last_packet = asyncio.get_running_loop().time()
        self._evidence = b""
        self._others: set[int] = set()

    async def packets(self, seconds: float) -> list[tuple[Packet, int]]:
        """Return packets in order, each with its arrival, ns; empty if none arrives within ``seconds``.

        Raises ``ConnectError`` when the port is gone or silent, ``ProtocolError`` when the data do not match the
        settings, ``WrongDeviceError`` for other boards, or a board with another number of phases.
        """
        loop = asyncio.get_running_loop()
        end = self._last_packet + self._settings.silence
        came = await self._port.read(max(0.0, min(seconds, end - loop.time())), self._now, self._gather())
        packets = [(packet, arrival) for data, arrival in came for packet in self._decoder.feed(data)]
        for what, n in self._decoder.counts.items():
            if what in _GARBLED:
                self._account.anomaly(what, n)
            else:
                self._account.count(what, n)
        self._decoder.counts.clear()
        wanted = [received for received in packets if self._wants(received[0])]
        if wanted:
            self._last_packet, self._evidence = loop.time(), b""
            self._others.clear()
        else:
            self._evidence = b"".join((self._evidence, *(data for data, _ in came)))[-EVIDENCE:]
            if loop.time() >= end:
                raise self._verdict()
        return wanted

    def _wants(self, packet: Packet) -> bool:
        if not self._wanted:
            self._wanted = (packet.board,)
        if packet.board not in self._wanted:
            self._others.add(packet.board)
            self._account.count("other boards")
            return False
        if packet.phases != self._settings.phases:
            raise WrongDeviceError(
                f"{self._settings.port}: board {packet.board} measures {packet.phases} phases, "
                f"but phases: {self._settings.phases} is configured"
            )
        return True

    def _verdict(self) -> SourceError:
        """Return the error that explains why no wanted packet was received."""
        s = self._settings
        where, span = f"{s.port}: in {s.silence:g} s", f"at {s.baud} baud"
        if self._others:
            wanted, others = (", ".join(map(str, boards)) for boards in (self._wanted, sorted(self._others)))
            return WrongDeviceError(f"{where} only board {others} is received, but not the wanted board {wanted}")
        if self._evidence:
            reason = wire.diagnose(self._evidence, s.mode)
            return ProtocolError(f"{where} bytes but no valid frame {span}: {reason}")
        return ConnectError(
            f"{where} not one byte {span}: is the board on and joined, and is this the receiver's port?"
        )
