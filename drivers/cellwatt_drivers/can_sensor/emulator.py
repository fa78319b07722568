"""An Isabellenhütte IVT-S on a CAN bus."""

from __future__ import annotations

import asyncio
import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

from cellwatt.driver import SourceSettings
from cellwatt.emulation import Emulator, Options
from cellwatt.emulation.faults import FaultKind
from cellwatt.emulation.terminal import PtyPort, Writer
from cellwatt.ticker import Ticker
from cellwatt_drivers.can_sensor.sensor_map import Decoding, load_decodings


class CanSensorEmulator(Emulator):
    """An IVT-S that measures ``bus.current`` and ``bus.voltage``, and sends each result in its cycle.

    The address is ``pty`` or the path of a link to it: an slcan adapter. Options: ``cycles`` (stream=ms,
    comma-separated: the results to send, with their cycles; current=20,voltage_1=60,voltage_2=60,voltage_3=60),
    ``status`` (hex digit of the error flags in byte 1).

    Faults strike frames. ``loss``: not sent, but counted by the message counter; ``duplicate``: sent twice;
    ``garbage``: random bytes before it; ``half_frame``: cut; ``stall``: nothing is sent for a time, then all that was
    due; ``disconnect``: the bus is off for ``seconds``, and results due are lost. ``made`` counts results, ``sent``
    those that a client received whole, ``unheard`` those made while no client had the adapter open, ``disconnected``
    those lost in a disconnect.
    """

    title: ClassVar[str] = "Isabellenhütte IVT-S current sensor (CAN)"
    usual_address: ClassVar[str] = "pty"
    line = "channel"
    faults: ClassVar[tuple[FaultKind, ...]] = ("loss", "duplicate", "garbage", "half_frame", "stall", "disconnect")

    @classmethod
    def address_in(cls, settings: Any) -> str:
        """See ``Emulator.address_in``; an emulator cannot listen at a bus of this PC's kernel."""
        return str(settings.channel) if settings.interface == "slcan" else f"{settings.interface}:{settings.channel}"

    @classmethod
    def options_for(cls, sources: Sequence[Any]) -> dict[str, str]:
        """See ``Emulator.options_for``: the streams that are read, at their rates in the settings."""
        settings = sources[0]
        if settings.sensor != "ivt_s" or len(sources) > 1:
            raise ValueError("the emulated sensor is one IVT-S, the only one on its bus")
        streams = load_decodings("ivt_s", None)[0].streams
        read = settings.read or [name for name, stream in streams.items() if not stream.optional]
        cycles = {name: 1 / settings.rates[name] if name in settings.rates else streams[name].cycle for name in read}
        return {"cycles": ",".join(f"{name}={1e3 * cycle:g}" for name, cycle in cycles.items())}

    @classmethod
    def settings_at(cls, address: str, settings: SourceSettings) -> dict[str, Any]:
        """See ``Emulator.settings_at``."""
        return {"interface": "slcan", "channel": address}

    def set_up(self, options: Options) -> None:
        """See ``Emulator.set_up``."""
        if not self.on_terminal:
            raise ValueError(f"an IVT-S is emulated at pty or a path, not at {self.address!r}")
        _, self._decodings = load_decodings("ivt_s", None)
        text = options.text("cycles", "current=20,voltage_1=60,voltage_2=60,voltage_3=60")
        pairs = (pair.partition("=") for pair in text.split(","))
        self._cycles = {name: float(milliseconds) * 1e-3 for name, _, milliseconds in pairs}
        if unknown := set(self._cycles) - set(self._decodings):
            raise ValueError(f"an IVT-S has no {', '.join(sorted(unknown))}; it has: {', '.join(self._decodings)}")
        self.status = int(options.text("status", "0"), 16)
        self._numbers: Counter[str] = Counter()
        self.tally.update(unheard=0, disconnected=0)
        self._energy = 0.0
        self._off = 0.0
        self._blocked = 0.0
        self._open = False
        self._writer: Writer | None = None

    async def serve(self, ready: Callable[[str], None]) -> None:
        """See ``Emulator.serve``."""
        async with PtyPort(self, self._obey) as place:
            ready(place)
            await self._measure()

    async def _obey(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        """Execute O, L, C and S like an adapter that sends frames while it is open."""
        self._writer = writer
        while True:
            command = (await reader.readuntil(b"\r"))[:1]
            self._open = command != b"C" and (self._open or command in (b"O", b"L"))
            writer.write(b"\r")

    def write(self, data: bytes) -> bool:
        """Send bytes to the client; false if it does not read."""
        try:
            return self._writer is not None and self._writer.write(data) == len(data)
        except BlockingIOError:
            return False

    def _send(self, identifier: int, data: bytes) -> bool:
        """Send a standard frame to the client; true if the client accepted it."""
        return self._open and self.write(f"t{identifier:03X}{len(data)}{data.hex().upper()}\r".encode())

    async def _measure(self) -> None:
        due = dict.fromkeys(self._cycles, 0.0)
        start = time.monotonic()
        async with Ticker(1 / min(self._cycles.values())) as ticker:
            async for _ in ticker:
                now = time.monotonic()
                if stall := self.injector.once("stall"):
                    self._blocked = now + stall.seconds
                if outage := self.injector.once("disconnect"):
                    self._off = now + outage.seconds
                if now < self._blocked:
                    continue
                for name, cycle in self._cycles.items():
                    while due[name] <= now - start:
                        due[name] += cycle
                        self._result(name, now)

    def _result(self, name: str, now: float) -> None:
        decoding = self._decodings[name]
        data = self._data(name, decoding)
        self.tally["made"] += 1
        strikes = self.injector.strikes
        if now < self._off:
            self.tally["disconnected"] += 1
            return
        if strikes("loss", now):
            return
        if strikes("garbage", now):
            self.write(self.injector.random_bytes(1, 8).replace(b"\r", b"?") + b"\r")
        identifier, send = decoding.message.frame_id, self._send
        if strikes("half_frame", now):
            send(identifier, data[:3])
            return
        self.tally["sent" if send(identifier, data) else "unheard"] += 1
        if strikes("duplicate", now):
            send(identifier, data)

    def _data(self, name: str, decoding: Decoding) -> bytes:
        prefix = next(iter(decoding.wanted.signals))
        number = self._numbers[name] % 16
        self._numbers[name] += 1
        values: dict[str, Any] = {
            f"{prefix}_Kind": decoding.message.frame_id - 0x521,
            f"{prefix}_System_Error": self.status >> 3 & 1,
            f"{prefix}_Measurement_Error": self.status >> 2 & 1,
            f"{prefix}_Channel_Error": self.status >> 1 & 1,
            f"{prefix}_Overcurrent": self.status & 1,
            f"{prefix}_Counter": number,
            prefix: self._measured(name) / decoding.factors[0],
        }
        return bytes(decoding.message.encode(values, strict=False))

    def _measured(self, name: str) -> float:
        now = self.world()
        voltage, current = now.get("bus.voltage", 0.0), now.get("bus.current", 0.0)
        if name == "energy":
            self._energy += voltage * current * self._cycles[name]
        values = {"voltage": voltage, "current": current, "power": voltage * current, "temperature": 31.0}
        return values.get(name.partition("_")[0], self._energy)
