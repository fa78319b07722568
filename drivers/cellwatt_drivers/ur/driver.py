"""Reads a Universal Robots controller over RTDE."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager

from pydantic import Field, field_validator

from cellwatt.account import Account
from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt.together import until_one_ends
from cellwatt_drivers.ur import session as rtde
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.clock_check import compare
from cellwatt_drivers.ur.fields import cycle_rate, decimation
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Selection
from cellwatt_drivers.ur.wire import ControllerVersion

PORT = 30004
FASTEST = 500.0

DEFAULT_CHANNELS = (
    "actual_q",
    "actual_qd",
    "actual_current",
    "target_q",
    "target_qd",
    "target_moment",
    "joint_temperatures",
    "actual_robot_voltage",
    "actual_robot_current",
    "actual_main_voltage",
    "speed_scaling",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "bus.power",
)


class UrSettings(SourceSettings):
    """A Universal Robots arm: CB3, e-Series or newer, over RTDE (enable it under Security → Services)."""

    host: Host
    """Address or name of the controller."""
    port: int = Field(PORT, ge=1, le=65535)
    """TCP port of RTDE."""
    rate: Hertz = Field(FASTEST, ge=1, le=FASTEST)
    """Packages a second: up to 500 Hz, on CB3 up to 125 Hz (a higher rate is reduced to that)."""
    channels: tuple[str, ...] = DEFAULT_CHANNELS
    """RTDE fields (``actual_q``) or single channels (``joint_1.position``, ``bus.power``)."""
    timeout: Seconds = Field(2.0, gt=0)
    """Silence after which the connection is closed and opened again."""

    @field_validator("channels")
    @classmethod
    def _known(cls, channels: tuple[str, ...]) -> tuple[str, ...]:
        wire.ask_outputs(FASTEST, Selection.of(channels).names)
        return channels


class UrDriver(Driver[UrSettings]):
    """One robot's RTDE output as one stream on the controller's clock."""

    Settings = UrSettings
    title = "Universal Robots arm over RTDE (CB3, e-Series and newer)"
    emulator = "cellwatt_drivers.ur.emulator:UrEmulator"
    writes = (
        "V: asks to speak protocol version 2",
        "v: asks for the controller's version",
        "O: asks for output fields at a rate; about six times a minute, on a short connection, for the timestamp alone",
        "S: asks to start sending",
        "P: asks to stop sending, when leaving",
    )

    def __init__(self, name: str, settings: UrSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        self._selection = Selection.of(settings.channels)
        self._stream = Stream("rtde", self._selection.channels, settings.rate, "device")
        self._intake = Intake(inlet, self._stream)

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The one stream, ``rtde``."""
        return (self._stream,)

    async def run(self) -> None:
        """See ``Driver.run``."""
        async with self._connect(self.inlet.account) as (session, version):
            await self._read(session, version, self._open(version))

    async def _read(self, session: rtde.Session, version: ControllerVersion, rate: float) -> None:
        s, inlet, intake = self.settings, self.inlet, self._intake
        session.say = intake.message
        await rtde.begin(session, version, self._selection, rate, intake.take, s.timeout)
        await until_one_ends(
            rtde.attend(session, intake, s.timeout),
            compare(s.host, s.port, cycle_rate(version), s.timeout, inlet.now, inlet.account, intake),
        )

    async def identify(self) -> Identity:
        """See ``Driver.identify``."""
        async with self._connect(Account()) as (_, version):
            return _identity(version)

    def _connect(self, account: Account) -> AbstractAsyncContextManager[tuple[rtde.Session, ControllerVersion]]:
        s = self.settings
        return rtde.connect(s.host, s.port, s.timeout, self.inlet.now, account, self.gather)

    def _open(self, version: ControllerVersion) -> float:
        """Report the controller to the intake; returns the rate in Hz at which such a controller sends."""
        loop, wanted = cycle_rate(version), self.settings.rate
        rate = loop / decimation(loop, wanted)
        self.rates = {self._stream.name: rate}
        if abs(rate / wanted - 1) > 1e-6:
            self.inlet.event("rate", f"{wanted:g} Hz is wanted; PolyScope {version} sends {rate:g} Hz", rate=rate)
        self._intake.opened(_identity(version), loop, rate)
        return rate


def _identity(version: ControllerVersion) -> Identity:
    model = {3: "CB3", 5: "e-Series"}.get(version.major, "UR controller")
    return Identity("Universal Robots", model, firmware=f"PolyScope {version}", notes={"protocol": "RTDE 2"})
