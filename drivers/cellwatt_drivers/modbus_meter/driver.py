"""Polls an energy meter over Modbus."""

from __future__ import annotations

import math
import time
from contextlib import AbstractAsyncContextManager
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FilePath, model_validator

from cellwatt.channel import Quality, Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import ConnectError, DeviceError, ProtocolError, SourceError, WrongDeviceError
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt.slots import Slots
from cellwatt_drivers.modbus_meter import likeness
from cellwatt_drivers.modbus_meter.counter import Counted, RisingCounter
from cellwatt_drivers.modbus_meter.meter_map import MeterName, chosen_map
from cellwatt_drivers.modbus_meter.reader import Reader
from cellwatt_drivers.shared.choice import Chosen, SerialPath, among
from cellwatt_drivers.shared.modbus import (
    ILLEGAL_FUNCTION,
    Bus,
    Framing,
    OtherNumberError,
    Parity,
    RefusedError,
    SerialPlace,
    TcpPlace,
    line,
)
from cellwatt_drivers.shared.polling import NoAnswerError, deliver, reason_of
from cellwatt_drivers.shared.requirements import require

PORT = 502

_ADVICE = (
    "check the address and the cable, that Modbus TCP is switched on at the meter, and that no other client holds its "
    "last connection"
)
_USUAL = {"timeouts", "retries", "refused reads"}
"""Counts that also rise on a good line."""
_PLAUSIBLE = {"J": 1e6}
"""Rise of a counter per second, by unit, that the first two values of a cell's meter do not exceed."""
_CHANGES = {
    "wrapped": "restarted at its end",
    "reset": "was reset; the published value continues to rise",
    "misread": "jumped or fell, and returned: its value was held",
    "held": "has not risen evenly for a minute: no new value is published; a value that may fall, like import less "
    "export, needs 'counter: false' in the map",
}


class ModbusMeterSettings(SourceSettings):
    """An energy meter on Modbus TCP (``host``) or on a serial line (``line``, Modbus RTU)."""

    reached_by: ClassVar[tuple[str, ...]] = ("host", "line")
    device_parts: ClassVar[tuple[str, ...]] = ("unit",)
    line_parts: ClassVar[tuple[str, ...]] = ("baud", "parity", "stop_bits")

    meter: MeterName | None = None
    """Model of the meter: one of the packaged maps."""
    map: FilePath | None = None
    """File with your own map instead of ``meter``."""
    host: Host | None = None
    """Address of the meter, or of the gateway in front of it."""
    port: int = Field(PORT, ge=1, le=65535)
    """TCP port."""
    framing: Framing = "tcp"
    """``rtu`` if ``host`` is a serial device server that passes bytes on unchanged."""
    line: SerialPath | None = None
    """Serial port instead of ``host``, e.g. ``/dev/serial/by-id/usb-…``; several sources may share one."""
    baud: int = Field(9600, ge=300, le=1_000_000)
    """Speed of the serial line, as set at the meter."""
    parity: Parity = "even"
    """Parity of the serial line, as set at the meter."""
    stop_bits: Literal[1, 2] = 1
    """Stop bits of the serial line."""
    unit: int = Field(1, ge=0, le=255)
    """Unit number of the meter on its line (also called address, slave or station)."""
    read: Chosen[str] | None = None
    """Channels to read; omitted: all of the map. Fewer channels are read faster."""
    rate: Hertz = 1.0
    """Polls a second."""
    window: Seconds | None = Field(None, gt=0)
    """Averaging window of each power, from the meter's data sheet; omitted: the map's value."""
    timeout: Seconds = Field(1.0, gt=0)
    """Longest wait for an answer."""
    retries: int = Field(1, ge=0, le=10)
    """Most repeated requests within one poll."""
    mains_may_be_off: bool = False
    """The meter has its own supply, and the measured mains may be off: 0 V and 0 Hz do not mean a wrong meter."""
    silence: Seconds = Field(5.0, gt=0)
    """Longest time without a good answer, at least two polls: after it the source is down and is opened again."""

    @model_validator(mode="after")
    def _fits(self) -> ModbusMeterSettings:
        if (self.host is None) == (self.line is None):
            raise ValueError("write either 'host' or 'line'")
        if (self.meter is None) == (self.map is None):
            raise ValueError("write either 'meter' (a packaged map) or 'map' (a file)")
        return self


class ModbusMeterDriver(Driver[ModbusMeterSettings]):
    """One meter. Every due poll is delivered, or counted as missed with its reason.

    Registers that the meter refuses to read together are then requested separately; a value that the meter refuses at
    the start of a connection is reported once and stays NaN during it. A later refusal costs its poll alone.
    """

    Settings = ModbusMeterSettings
    libraries = ("pymodbus.client",)
    title = "Energy meters over Modbus TCP and RTU (Eastron, Carlo Gavazzi, Schneider, Siemens, Shelly, own maps)"
    emulator = "cellwatt_drivers.modbus_meter.emulator:ModbusMeterEmulator"
    writes = (
        "read requests only: function 4 (read input registers) or 3 (read holding registers), as the map says, for "
        "the registers of the map and those between them",
        "where the first answers are another meter's, once: by function 4 or 3 the voltages and the frequency of the "
        "other packaged maps",
    )

    def __init__(self, name: str, settings: ModbusMeterSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        require(name, "driver modbus_meter", {"pymodbus": "the package pymodbus"}, "pip install 'cellwatt[modbus]'")
        self._map = chosen_map(settings.meter, settings.map)
        self._names = among(settings.read, self._map.values, f"a {self._map.model}")
        values = [self._map.values[n] for n in self._names]
        self._reader = Reader(self._map, self._names, settings.unit, settings.retries, self._count, self._left_out)
        self._factor = np.array([v.factor for v in values])
        self._largest = np.array([math.inf if v.largest is None else v.largest for v in values])
        self._counters = {
            c: RisingCounter(self._map.wrap(n), 1 / settings.rate, _PLAUSIBLE.get(values[c].channel(n).unit, 0.0))
            for c, n in enumerate(self._names)
            if values[c].counts
        }
        window = settings.window or self._map.window
        channels = tuple(v.channel(n, window) for n, v in zip(self._names, values, strict=True))
        self._stream = Stream("measured", channels, settings.rate, "host")
        self._slots = Slots(settings.rate, inlet.account.lose)
        self._last_answer = 0
        self._reported = ""
        self._overloaded: frozenset[str] = frozenset()

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The one stream, ``measured``."""
        return (self._stream,)

    async def identify(self) -> Identity:
        """Identity of the map's meter, after its registers were read. Raises ``SourceError``."""
        async with self._open() as bus:
            return await self._greet(bus)

    async def run(self) -> None:
        """See ``Driver.run``."""
        async with self._open() as bus:
            self.inlet.connected(await self._greet(bus))
            self._last_answer = time.monotonic_ns()
            async with self._slots as slots:
                async for _ in slots:
                    await self._serve(bus)

    def _open(self) -> AbstractAsyncContextManager[Bus]:
        s = self.settings
        serial = SerialPlace(s.line or "", s.baud, s.parity, s.stop_bits)
        return line(serial if s.host is None else TcpPlace(s.host, s.port, s.framing, _ADVICE))

    async def _greet(self, bus: Bus) -> Identity:
        unit, meter = self.settings.unit, self._map
        async with bus.turn(self.settings.timeout):
            try:
                raw = await self._reader.read(bus)
                arrival = self.inlet.now()
            except WrongDeviceError as error:
                raise await likeness.wrong(bus, unit, meter, "it has none of its registers") from error
            except RefusedError as error:
                if error.code != ILLEGAL_FUNCTION:
                    raise
                raise await likeness.wrong(bus, unit, meter, f"it reads no {meter.function} registers") from error
            except NoAnswerError as error:
                hinted = meter.delivered and not isinstance(error, OtherNumberError)
                delivered = f"; a {meter.model} is delivered with {meter.delivered}" if hinted else ""
                raise ConnectError(f"{error}{delivered}") from error
            values, _ = self._in_si(raw)
            found = {n: float(v) for n, v in zip(self._names, raw, strict=True) if n not in self._reader.left_out}
            self.left_out = frozenset(self._reader.left_out)
            await likeness.examine(bus, unit, meter, found, self.settings.mains_may_be_off)
        self._count_on(values, arrival)  # a counter needs two first values that agree
        notes = {"map": meter.source, "requests a poll": str(len(self._reader.blocks))}
        return Identity(meter.maker, meter.model, notes=notes)

    def _count(self, what: str) -> None:
        account = self.inlet.account
        (account.count if what in _USUAL else account.anomaly)(what)

    def _left_out(self, name: str, error: RefusedError) -> None:
        if name not in self.left_out:
            self.left_out |= {name}
            self.inlet.event("value_refused", f"{self.name}: {name} is left out: {error}", channel=name)

    async def _serve(self, bus: Bus) -> None:
        try:
            async with bus.turn(self.settings.timeout):
                raw = await self._reader.read(bus, anew=False)
                arrival = self.inlet.now()
                asked = arrival - time.monotonic_ns() + self._reader.asked
        except SourceError as error:
            self.inlet.account.lose(1, reason_of(error))
            if isinstance(error, RefusedError | OtherNumberError) and str(error) != self._reported:
                self._reported = str(error)
                self.inlet.event("device_error", f"{self.name}: {error}")
            if not isinstance(error, NoAnswerError | RefusedError | ProtocolError):
                raise
            silence = (time.monotonic_ns() - self._last_answer) * 1e-9
            if silence > max(self.settings.silence, 2 / self.settings.rate):
                kind = DeviceError if isinstance(error, RefusedError) else ConnectError
                raise kind(f"no good answer for {silence:.1f} s; the last: {error}") from error
        else:
            self._reported = ""
            self._last_answer = time.monotonic_ns()
            values, quality = self._measured(raw, arrival)
            deliver(self.inlet, self._stream, values, asked, arrival, quality)

    def _measured(self, raw: NDArray[np.float64], arrival: int) -> tuple[NDArray[np.float64], Quality]:
        """Convert register numbers, read at ``arrival`` ns, to SI units; return the values and their quality."""
        row, over = self._in_si(raw)
        quality = Quality.INTERPOLATED if self._count_on(row, arrival) else Quality.GOOD
        if np.isnan(row).all():
            quality = Quality.MISSING
        if over.any():
            quality = Quality.CLIPPED
            self.inlet.account.count("overloads")
        overloaded = frozenset(n for n, o in zip(self._names, over, strict=True) if o)
        if new := overloaded - self._overloaded:
            listed = ", ".join(sorted(new))
            self.inlet.event("overload", f"{self.name}: {listed} beyond the meter's range", channels=listed)
        self._overloaded = overloaded
        return row, quality

    def _in_si(self, raw: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the values in SI units, NaN for no value, and the flags of those beyond the meter's range."""
        over = np.abs(raw) > self._largest
        return np.where(over | ~np.isfinite(raw), np.nan, raw) * self._factor, over

    def _count_on(self, row: NDArray[np.float64], arrival: int) -> bool:
        """Replace counters by values that only rise; return whether any value is held."""
        held = False
        for column, counter in self._counters.items():
            counted = counter.take(float(row[column]), arrival * 1e-9)
            row[column] = counted.value
            held |= counted.held
            self._note_counter(self._names[column], counted)
        return held

    def _note_counter(self, name: str, counted: Counted) -> None:
        if counted.misread:
            self.inlet.account.count("counter misread", counted.misread)
        if counted.change:
            self.inlet.event(
                f"counter_{counted.change}", f"{self.name}: {name} {_CHANGES[counted.change]}", channel=name
            )
