"""Listens to sensors on a CAN bus."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field, FilePath, field_validator, model_validator

from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import ConfigError, ConnectError, SourceError, WrongDeviceError
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.can_sensor.bus_errors import BusState, decode_error
from cellwatt_drivers.can_sensor.intake import Intake
from cellwatt_drivers.can_sensor.listening import BusPlace, Interface, Listening, open_listening
from cellwatt_drivers.can_sensor.sensor_map import (
    ANY_DESTINATION,
    ANY_SOURCE,
    SensorName,
    group_of,
    has_destination,
    load_decodings,
)
from cellwatt_drivers.shared.choice import Chosen, among
from cellwatt_drivers.shared.requirements import require

if TYPE_CHECKING:
    from can import Message

_BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)
_MOST_OTHERS = 8


class CanSensorSettings(SourceSettings):
    """A sensor on a CAN bus: one of the packaged ones, or any other with a DBC file and your own map."""

    reached_by: ClassVar[tuple[str, ...]] = ("channel",)

    sensor: SensorName | None = None
    """Model of the sensor: one of the packaged maps."""
    map: FilePath | None = None
    """File with your own map instead of ``sensor``."""
    interface: Interface = "socketcan"
    """Interface through which python-can accesses the bus."""
    channel: str = "can0"
    """Network interface (``can0``), or serial port of an slcan adapter."""
    bitrate: int | None = None
    """Bit rate, bit/s, to set at an slcan adapter; omitted: unchanged. SocketCAN's rate is set with ``ip link``."""
    listen_only: bool = False
    """Set an slcan adapter not to acknowledge frames; another node must then do so."""
    source_address: int | None = Field(None, ge=0, le=253)
    """J1939: address of the sensor; omitted: the DBC file's, or if that is 254 the first that sends."""
    settle: Seconds = Field(0.0, ge=0, le=10)
    """Pause after opening an slcan adapter; adapters that restart when opened need 2 s."""
    read: Chosen[str] | None = None
    """Streams to read; omitted: those of the map that are not optional."""
    rates: dict[str, Hertz] = Field(default_factory=dict)
    """Messages per second, by stream, if the sensor's settings differ from the map."""
    silence: Seconds = Field(2.0, gt=0)
    """Longest time without a frame of the sensor: after it the bus is closed and opened again."""

    @field_validator("bitrate")
    @classmethod
    def _known_rate(cls, bitrate: int | None) -> int | None:
        if bitrate is not None and bitrate not in _BITRATES:
            raise ValueError(f"expected one of {', '.join(map(str, _BITRATES))}")
        return bitrate

    @model_validator(mode="after")
    def _fits(self) -> CanSensorSettings:
        if (self.sensor is None) == (self.map is None):
            raise ValueError("write either 'sensor' (a packaged map) or 'map' (a file)")
        if self.interface != "slcan" and (self.bitrate is not None or self.listen_only):
            raise ValueError("'bitrate' and 'listen_only' are for slcan; SocketCAN's are set with ip link")
        if self.interface == "slcan" and not self.channel.startswith("/"):
            raise ValueError("'channel' of slcan is the path of a serial port, like '/dev/serial/by-id/usb-…'")
        return self


class CanSensorDriver(Driver[CanSensorSettings]):
    """One sensor; several sensors may share a bus. The driver never sends a frame to the bus.

    Samples carry the time at which the PC received the frame, so each stream has its own clock model. The state of a
    message's counter outlives the connection.
    """

    Settings = CanSensorSettings
    libraries = ("can", "cantools")
    title = "Sensors on a CAN bus by DBC file (Isabellenhütte IVT-S, own maps)"
    emulator = "cellwatt_drivers.can_sensor.emulator:CanSensorEmulator"
    writes = (
        "no frame to the bus; its controller acknowledges frames of others unless it is set to listen only",
        "slcan only, to the adapter: C (close), S<n> (bit rate, where bitrate is set), O or L (open, or listen only)",
    )

    def __init__(self, name: str, settings: CanSensorSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        require(name, "driver can_sensor", {"can": "python-can", "cantools": "cantools"}, "pip install 'cellwatt[can]'")
        self._map, decodings = load_decodings(settings.sensor, settings.map)
        self._intakes: list[Intake] = []
        known = self._map.streams
        usual = tuple(n for n, s in known.items() if not s.optional) or None
        among(tuple(settings.rates), known, f"the map of {self._map.model}", "rates")
        for stream in among(settings.read or usual, known, f"the map of {self._map.model}"):
            rate = settings.rates.get(stream)
            period = 1 / rate if rate else self._map.streams[stream].cycle
            self._intakes.append(Intake(name, decodings[stream], period, inlet))
        self._by_frame: dict[tuple[int, bool], list[Intake]] = {}
        self._by_group: dict[int, list[Intake]] = {}
        """Intakes of J1939's messages."""
        self._source: int | None = None
        """J1939: source address of the first node that sent, where settings and DBC file name none."""
        for intake in self._intakes:
            if decodings[intake.stream.name].is_j1939:
                self._by_group.setdefault(group_of(intake.identifier[0]), []).append(intake)
            else:
                self._by_frame.setdefault(intake.identifier, []).append(intake)
        if settings.source_address is not None and not self._by_group:
            raise ConfigError(f"source_address: the DBC file of {self._map.model} declares no message as J1939")
        self._state: BusState = "active"
        self._others: set[int] = set()
        self._errors = 0
        self._dropped = 0
        self._malformed = 0

    @property
    def streams(self) -> tuple[Stream, ...]:
        """One stream per message that is read, or per page of it."""
        return tuple(i.stream for i in self._intakes)

    async def identify(self) -> Identity:
        """Identity of the map's sensor, after one of its frames was received. Raises ``SourceError``."""
        async with self._open() as listening:
            async for _ in self._heard(listening):
                break
        return self._identity()

    async def run(self) -> None:
        """See ``Driver.run``."""
        for intake in self._intakes:
            intake.resume()
        self._source = None
        async with self._open() as listening:
            connected = False
            try:
                async for own in self._heard(listening):
                    for intake, frame in own:
                        intake.take(frame, listening.latest)
                    if not connected:
                        connected = True
                        self.inlet.connected(self._identity())
                    self._hand_over(listening)
            finally:
                self._hand_over(listening)

    def _open(self) -> AbstractAsyncContextManager[Listening]:
        s = self.settings
        options: dict[str, Any] = {}
        if s.interface == "slcan":
            options = {"listen_only": s.listen_only, "sleep_after_open": s.settle, "timeout": 0}
            options |= {} if s.bitrate is None else {"bitrate": s.bitrate}
        return open_listening(BusPlace(s.interface, s.channel, options), self.inlet.now)

    async def _heard(self, listening: Listening) -> AsyncIterator[list[tuple[Intake, Message]]]:
        """Yield the sensor's frames, with their intakes. Raises ``SourceError`` after a ``silence`` without one."""
        self._others, self._errors, self._dropped, self._malformed = set(), 0, 0, 0
        loop = asyncio.get_running_loop()
        last_frame = loop.time()
        while (left := last_frame + self.settings.silence - loop.time()) > 0:
            frames = await listening.frames(left)
            if own := [(intake, frame) for frame in frames for intake in self._intakes_of(frame)]:
                last_frame = loop.time()
                yield own
        raise self._verdict(listening.place)

    def _identity(self) -> Identity:
        messages = ", ".join(f"{i.stream.name} 0x{i.identifier[0]:X}" for i in self._intakes)
        return Identity(self._map.maker, self._map.model, notes={"messages": messages, "map": self._map.source})

    def _intakes_of(self, frame: Message) -> list[Intake]:
        """Return the intakes of a frame; note errors and frames of others."""
        if frame.is_error_frame:
            self._note_error(frame)
            return []
        if self._state == "off":  # restarted while the bus was closed: a controller that is off receives no frame
            self._enter("active")
        intakes: list[Intake] = []
        if not frame.is_remote_frame:
            number, extended = frame.arbitration_id, frame.is_extended_id
            intakes += self._by_frame.get((number, extended), ())
            group = self._by_group.get(group_of(number), ()) if extended else ()
            intakes += [i for i in group if self._is_own(i.identifier[0], number)]
        if not intakes:
            self.inlet.account.count("other frames")
            if len(self._others) < _MOST_OTHERS:
                self._others.add(frame.arbitration_id)
        return intakes

    def _is_own(self, declared: int, sent: int) -> bool:
        """True if an identifier of the declared group is the sensor's: other nodes may send the same messages."""
        if has_destination(declared) and declared >> 8 & 0xFF not in (*ANY_DESTINATION, sent >> 8 & 0xFF):
            return False
        source, wanted = sent & 0xFF, self.settings.source_address
        if wanted is None and (wanted := declared & 0xFF) == ANY_SOURCE:
            self._source = wanted = source if self._source is None else self._source
        return source == wanted

    def _note_error(self, frame: Message) -> None:
        error = decode_error(frame.arbitration_id, bytes(frame.data))
        self._errors += 1
        self.inlet.account.anomaly("error frames")
        for what in error.names:
            self.inlet.account.count(f"error frames: {what}")
        if error.overflow:
            self.inlet.account.anomaly("controller overflows")
        if error.state is not None and error.state != self._state:
            self._enter(error.state)

    def _enter(self, state: BusState) -> None:
        """Report a new state of the controller."""
        self._state = state
        self.inlet.event(f"bus_{state}", f"{self.name}: {self.settings.channel}: {_STATES[state]}")

    def _hand_over(self, listening: Listening) -> None:
        for intake in self._intakes:
            intake.flush(listening.latest)
        self.inlet.account.anomaly("frames dropped", listening.dropped - self._dropped)
        self.inlet.account.anomaly("malformed", listening.malformed - self._malformed)
        self._dropped, self._malformed = listening.dropped, listening.malformed

    def _verdict(self, place: BusPlace) -> SourceError:
        """Return the error that explains why no frame of the sensor was received."""
        where = f"{place}: in {self.settings.silence:g} s"
        if self._state == "off":
            return ConnectError(
                f"{where} no frame: the controller is bus-off; set restart-ms with ip link, check wires"
            )
        if self._others:
            others = ", ".join(f"0x{i:X}" for i in sorted(self._others))
            wanted = ", ".join(sorted({f"0x{intake.identifier[0]:X}" for intake in self._intakes}))
            return WrongDeviceError(f"{where} only frames {others}, none of the {self._map.model}'s ({wanted})")
        if self._errors:
            return ConnectError(f"{where} only {self._errors} error frames: wrong bit rate, or a wire is off?")
        return ConnectError(f"{where} not one frame: is the sensor on, is the bit rate right, is the bus terminated?")


_STATES: dict[BusState, str] = {
    "active": "the controller is active again",
    "warning": "the controller sees many errors (warning level)",
    "passive": "the controller sees so many errors that it is error-passive",
    "off": "the controller is bus-off: it stays off the bus until it is restarted",
}
