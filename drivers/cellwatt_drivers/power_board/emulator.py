"""A power board and its XBee receiver, behind a pseudo-terminal."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cellwatt.emulation import Emulator, Fault, Options
from cellwatt.emulation.blocks import Blocks
from cellwatt.emulation.faults import FAULT_KINDS
from cellwatt_drivers.power_board import payload, wire, xbee
from cellwatt_drivers.power_board.virtual_port import VirtualPort

SENDER, NETWORK = 0x0013A20040401122, 0x1A2B
TICK = 0.004
SETTLE = 0.3
"""Time, s, after which a client that has the port open counts as listening even if it never flushed the port."""
LINGER = (0.05, 1.0)
"""Shortest and longest time, s, for which a disappearing port waits for its last bytes to be read."""
AHEAD = 12
"""Fewest samples computed at once: computed one by one, they are so slow that the board lags on a busy PC."""
MOST_WAITING = 10_000
"""Most packets queued for a client that does not read; the oldest of more are lost."""

_ROUNDING = 1e-6  # of a sample


class _Item(NamedTuple):
    """Bytes for the serial line, when they may be sent (s, monotonic), and their number of whole samples."""

    due: float
    data: bytes
    samples: int


class PowerBoardEmulator(Emulator):
    """A board that measures ``supply.power``, ``.voltage`` and ``.current``, divided evenly among its phases.

    The address is ``pty``, or the path of a symbolic link to it, which stays the same when the port returns. The board
    starts when a client first opens the port, so every sample it makes could be read; a sample made while no client has
    the port open counts as ``unheard``.

    Options: ``mode`` (api, api_escaped, transparent), ``board`` (0–255), ``phases`` (1–3), ``rate`` (Hz), ``batch``
    (samples per radio packet), ``explicit`` (yes: frame type 0x91 in place of 0x90), ``link`` (the link's path, as an
    option).

    Faults strike radio packets. ``loss``; ``half_frame``: cut off; ``garbage``: random bytes before it; ``duplicate``:
    sent twice; ``reorder``: overtaken by the next one; ``delay``: it and all behind it wait; ``stall``: nothing is sent
    for a time, then everything is; ``disconnect``: the port disappears (needs a link). ``made``, ``sent``
    (whole, to an open port) and ``unheard`` count samples, the faults and ``packets`` count packets, ``heard`` bytes
    from a client.
    """

    title: ClassVar[str] = "Power board behind an XBee receiver"
    usual_address: ClassVar[str] = "pty"
    line = "port"
    faults = tuple(kind for kind in FAULT_KINDS if kind != "clock_jump")

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``."""
        settings = sources[0]
        boards = settings.boards or (7,)
        if len(boards) > 1:
            raise ValueError("there is one emulated board at a port, and 'boards' names several")
        form = {"mode": settings.mode, "board": str(boards[0]), "phases": str(settings.phases)}
        return form | {"rate": f"{settings.rate!r}"}

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        if not self.on_terminal:
            raise ValueError(f"a power board's emulator listens at pty or a path, not at {self.address!r}")
        self._set_options(options)
        self.tally.update(unheard=0, packets=0, heard=0)
        self._blocks = Blocks(self._phase_values, 1 / self._rate, self._batch * -(-AHEAD // self._batch))
        self._began: float | None = None
        self._woke = 0.0  # UTC of the first sample, s
        self._opened: float | None = None  # when a client opened the port
        self._listened = False
        self._leaving: float | None = None  # s for which the port will be gone once all bytes are read
        self._left_at = 0.0  # when the disconnect began
        self._away = 0.0  # when the port returns
        self._blocked = 0.0  # when sending resumes
        self._line: deque[_Item] = deque()
        self._overtaken: list[_Item] = []

    def _set_options(self, options: Options) -> None:
        self._mode: wire.Mode = options.choice("mode", "api", wire.MODES)
        self._board = options.whole("board", 7)
        self._phases = options.whole("phases", 3)
        self._rate = options.number("rate", 123.0)
        self._batch = options.whole("batch", 1)
        self._explicit = options.flag("explicit", False)
        self.address = options.text("link", self.address)
        if not 0 < self._rate <= 1000:
            raise ValueError(f"rate {self._rate:g} is not within 0 to 1000 Hz")
        zeros = (0,) * (3 * self._phases * self._batch)
        payload.build(payload.Packet(self._board, 0, 0, self._step, self._phases, zeros))

    @property
    def _step(self) -> int:
        """µs between the samples of a packet; 0 for packets of one sample."""
        return round(1e6 / self._rate) if self._batch > 1 else 0

    def inject(self, fault: Fault) -> None:
        """See ``Emulator.inject``."""
        if fault.kind == "disconnect" and self.link is None:
            raise ValueError("a disconnect needs the option link: without it clients cannot find the port again")
        super().inject(fault)

    def disturb(self, change: Mapping[str, float | str]) -> None:
        """See ``Emulator.disturb``."""
        super().disturb(change)
        self._blocks.forget()

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        port = VirtualPort(self.link)
        try:
            ready(port.path)
            while True:
                self._tick(port, time.monotonic())
                await asyncio.sleep(TICK)
        finally:
            port.unplug()

    def _tick(self, port: VirtualPort, now: float) -> None:
        self._plug(port, now)
        self._listen(port, now)
        if (fault := self.injector.once("stall")) is not None:
            self._blocked = now + fault.seconds
        self._measure(now)
        self._send(port, now)

    def _plug(self, port: VirtualPort, now: float) -> None:
        """Remove the port, once sent bytes have been read, and restore it."""
        if not port.plugged:
            if now >= self._away:
                port.plug()
        elif self._leaving is None:
            if (fault := self.injector.once("disconnect")) is not None:
                self._leaving, self._left_at = fault.seconds, now
        elif now - self._left_at >= (LINGER[1] if port.unread else LINGER[0]):
            port.unplug()
            self._away, self._leaving = now + self._leaving, None
            self.tally["unheard"] += sum(item.samples for item in self._overtaken)
            self._overtaken.clear()

    def _listen(self, port: VirtualPort, now: float) -> None:
        """Check whether a client has opened the port, and read its bytes."""
        if not port.opened or self._leaving is not None:
            self._opened, self._listened = None, False
            return
        self._opened = now if self._opened is None else self._opened
        self.tally["heard"] += len(port.read())
        if self._listened or not (port.flushed or now >= self._opened + SETTLE):
            return
        self._listened = True
        if self._mode != "transparent":
            self._line.append(
                _Item(now, xbee.frame(bytes([xbee.MODEM_STATUS, 2]), escaped=self._mode == "api_escaped"), 0)
            )
        if self._began is None:
            self._began, self._woke = now, time.time()

    def _measure(self, now: float) -> None:
        """Make the packets whose last sample is due."""
        if self._began is None:
            return
        due = int((now - self._began) * self._rate + 1 + _ROUNDING) // self._batch
        missed = max(0, due - self.tally["packets"] - (MOST_WAITING if self._listened else 0))
        self._count(missed)
        self.tally["unheard"] += missed * self._batch
        while self.tally["packets"] < due:
            packet = self._packet(self.tally["made"])
            self._count(1)
            frame = wire.wrap(
                payload.build(packet), self._mode, sender=SENDER, network=NETWORK, explicit=self._explicit
            )
            self._transmit(frame, now)

    def _count(self, packets: int) -> None:
        self.tally["packets"] += packets
        self.tally["made"] += packets * self._batch

    def _packet(self, first: int) -> payload.Packet:
        """The samples from number ``first`` on."""
        microseconds = round(first / self._rate * 1e6)
        values, row = self._blocks.at(first)
        raw = payload.raw(values[row : row + self._batch])
        sequence, stamp = first % payload.SEQUENCE_WRAP, microseconds % payload.TIME_WRAP
        return payload.Packet(self._board, sequence, stamp, self._step, self._phases, raw)

    def _phase_values(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, phases, 3) V, A, W at t (n,) s after the first sample: an equal share of the supply for each phase."""
        signals = self.signals.at(self._woke - self.epoch + t)
        power = signals.get("supply.power", np.zeros_like(t))
        voltage = signals.get("supply.voltage", np.full_like(t, 230.0))
        drawn = np.divide(power, voltage, out=np.zeros_like(t), where=voltage != 0)
        current = signals.get("supply.current", drawn)
        share = np.stack([voltage, current / self._phases, power / self._phases], axis=1)
        return np.repeat(share[:, None, :], self._phases, axis=1)

    def _transmit(self, frame: bytes, now: float) -> None:
        """Send a packet over the radio, subject to the faults."""
        # Two bytes are cut off a half frame, so that no chance byte completes it.
        pieces, whole, late = self.injector.left_of(frame, lambda packet: len(packet) - 2)
        if not pieces:
            return
        self._blocked = max(self._blocked, now + late)
        item = _Item(self._blocked, b"".join(pieces), self._batch if whole else 0)
        if self.injector.strikes("reorder", now):
            self._overtaken.append(item)
            return
        self._line.append(item)
        self._line.extend(i._replace(due=item.due) for i in self._overtaken)
        self._overtaken.clear()

    def _send(self, port: VirtualPort, now: float) -> None:
        """Write data that is due, as far as the line accepts it; without a listener it is lost."""
        while self._line and (self._line[0].due <= now or len(self._line) > MOST_WAITING):
            item = self._line[0]
            listening = self._opened is not None and len(self._line) <= MOST_WAITING
            written = port.write(item.data) if listening else len(item.data)
            if written < len(item.data):
                self._line[0] = item._replace(data=item.data[written:])
                return
            self.tally["sent" if listening else "unheard"] += item.samples
            self._line.popleft()
