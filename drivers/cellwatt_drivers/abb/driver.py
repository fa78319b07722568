"""Listens to an ABB controller's EGM stream and reads its web pages."""

from __future__ import annotations

import asyncio
import time
from typing import Annotated, ClassVar

from pydantic import Field, SecretStr, field_validator, model_validator

from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import ConnectError, SourceError
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.abb import wire
from cellwatt_drivers.abb.controller import Controller, Page, energy_stream, state_stream
from cellwatt_drivers.abb.egm import listening
from cellwatt_drivers.abb.intake import Intake
from cellwatt_drivers.abb.rws import RobotWare
from cellwatt_drivers.abb.web import Access, session
from cellwatt_drivers.shared.requirements import require

FASTEST = 250.0
_INSTALL = "pip install 'cellwatt[abb]'"
_LONGEST_PAUSE = 30.0  # s between tries of web pages that cannot be read
_CHECK = 0.25  # s between looks at whether anything comes


class AbbSettings(SourceSettings):
    """An ABB arm: IRC5 with RobotWare 6 or OmniCore with RobotWare 7."""

    device_parts: ClassVar[tuple[str, ...]] = ("mechanical_unit",)

    host: Host
    """Address of the controller."""
    port: int | None = Field(None, ge=1, le=65535)
    """TCP port of Robot Web Services; without it 80 (RobotWare 6) or 443 (RobotWare 7)."""
    robotware: RobotWare = 7
    """Generation of the controller: 6 for IRC5, 7 for OmniCore."""
    egm: tuple[wire.Group, ...] = ("joints", "planned", "state")
    """Groups to take from the EGM stream; ``[]`` does not listen to it."""
    egm_port: int = Field(wire.PORT, ge=1, le=65535)
    """UDP port of this PC to which the controller sends; each robot of a PC needs one of its own."""
    bind: Host = "0.0.0.0"
    """Address of this PC at which to listen."""
    rate: Hertz = FASTEST
    """Packets a second as the RAPID program asks for with ``\\SampleRate``: 250 Hz or a whole part of it."""
    axes: int = Field(6, ge=1, le=6)
    """Joints of the robot."""
    linear: tuple[Annotated[int, Field(ge=1, le=6)], ...] = ()
    """Joints of the robot that go along a line, ``[3]`` of a SCARA: their channels are in m and N."""
    external: tuple[wire.External, ...] = Field((), max_length=6)
    """External axes, in the controller's order; the seventh joint of a 7-axis arm is one."""
    web: tuple[Page, ...] = ("state", "energy")
    """Groups to read from Robot Web Services; ``[]`` does not ask it."""
    web_rate: Hertz = 2.0
    """Polls of the pages; more often than the controller makes a new energy figure."""
    user: str = "Default User"
    """User of Robot Web Services; one that may only read is best."""
    password: SecretStr = SecretStr("robotics")
    """Its password, best as ``${ABB_PASSWORD}``; ``robotics`` where none is given."""
    tls: bool | None = None
    """HTTPS; without it yes on RobotWare 7, no on RobotWare 6."""
    certificate: str | None = None
    """File with the certificate to trust; without it the controller's own is not checked."""
    mechanical_unit: str = "ROB_1"
    """The robot whose joints' energy is taken."""
    energy_unit: float = Field(1.0, gt=0, allow_inf_nan=False)
    """J per unit of the controller's energy figures; the manual does not name the unit."""
    timeout: Seconds = Field(2.0, gt=0)
    """Silence after which the source is down, and longest wait for a page."""

    @field_validator("egm", "web")
    @classmethod
    def _no_twins(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) != len(value):
            raise ValueError("name each once")
        return value

    @field_validator("rate")
    @classmethod
    def _whole_cycles(cls, rate: float) -> float:
        cycles = 1 / (rate * wire.CYCLE)
        if cycles < 1 - 1e-9 or abs(cycles - round(cycles)) > 1e-6:
            raise ValueError(f"{rate:g} Hz: a controller sends 250 Hz or a whole part of it (125 Hz, 62.5 Hz, 50 Hz …)")
        return rate

    @field_validator("web_rate")
    @classmethod
    def _gently(cls, rate: float) -> float:
        if rate > 10:
            raise ValueError(f"{rate:g} Hz is too much for a controller's web server: at most 10 Hz")
        return rate

    @model_validator(mode="after")
    def _linear_exist(self) -> AbbSettings:
        if self.linear and max(self.linear) > self.axes:
            raise ValueError(f"'linear' names joint {max(self.linear)}, 'axes' says {self.axes}")
        return self

    @model_validator(mode="after")
    def _something(self) -> AbbSettings:
        if not self.egm and not self.web:
            raise ValueError("name something in 'egm' or in 'web'")
        return self


class AbbDriver(Driver[AbbSettings]):
    """One robot. EGM and the web pages go on without each other; the source is down when neither answers."""

    Settings = AbbSettings
    libraries = ("aiohttp", "google.protobuf.message_factory")
    title = "ABB robots over EGM and Robot Web Services (IRC5, OmniCore)"
    emulator = "cellwatt_drivers.abb.emulator:AbbEmulator"
    least_delay: ClassVar[tuple[float, float]] = (
        0.0,
        0.02,
    )  # how long a measurement stays in a controller is not known
    writes = (
        "UDP: nothing, ever; the socket only receives",
        "HTTP GET, with user and password: /rw/system, /rw/panel/ctrlstate or ctrl-state, /rw/panel/opmode, "
        "/rw/panel/speedratio, /rw/rapid/execution, /rw/system/energy, and /logout when leaving",
    )

    def __init__(self, name: str, settings: AbbSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        self._intake: Intake | None = None
        self._controller: Controller | None = None
        streams: list[Stream] = []
        if settings.egm:
            require(name, "egm", {"google.protobuf": "the package protobuf"}, f"{_INSTALL}, or set egm: []")
            self._intake = self._make_intake()
            streams.append(self._intake.stream)
        if settings.web:
            require(name, "web", {"aiohttp": "the package aiohttp"}, f"{_INSTALL}, or set web: []")
            self._controller, web_streams = self._make_controller()
            streams += web_streams
        self._streams = tuple(streams)
        self._greeted = False
        self._heard = 0.0
        self._trouble: SourceError | None = None

    def _make_intake(self) -> Intake:
        s = self.settings
        found = wire.columns(s.egm, s.axes, s.external, s.robotware, s.linear)
        return Intake(self.inlet, Stream("egm", found.channels, s.rate, "device"), found, self._delivers)

    def _make_controller(self) -> tuple[Controller, list[Stream]]:
        s = self.settings
        state = state_stream(s.web_rate) if "state" in s.web else None
        energy = energy_stream(s.axes) if "energy" in s.web else None
        made = Controller(self.inlet, s.web_rate, state, energy, s.robotware, s.mechanical_unit, s.energy_unit)
        return made, [stream for stream in (state, energy) if stream is not None]

    @property
    def streams(self) -> tuple[Stream, ...]:
        """``egm``, ``controller`` and ``energy``, as far as they are read."""
        return self._streams

    async def identify(self) -> Identity:
        """Identify the controller by its pages or, where they are not read, by the EGM packets that come."""
        if self._controller is not None:
            async with session(self._access()) as web:
                return await self._controller.identify(web)
        s = self.settings
        come = asyncio.Event()
        async with listening(s.host, s.bind, s.egm_port, self.inlet.account, lambda *_: come.set()):
            try:
                async with asyncio.timeout(s.timeout):
                    await come.wait()
            except TimeoutError:
                raise self._silence(s.timeout) from None
        return _listened()

    async def run(self) -> None:
        """See ``Driver.run``."""
        self._heard = time.monotonic()
        self._greeted = False
        self._trouble = None
        # In a task of its own: of Python 3.11.2 (Debian 12) a group leaves the task in which it failed marked as being
        # cancelled, and the next time limit in that task would end as a cancellation.
        await asyncio.create_task(self._read())

    async def _read(self) -> None:
        failure: SourceError | None = None
        try:
            async with asyncio.TaskGroup() as tasks:
                if self._intake is not None:
                    tasks.create_task(self._listen(self._intake))
                if self._controller is not None:
                    tasks.create_task(self._ask(self._controller))
                tasks.create_task(self._watch())
        except* SourceError as failures:
            failure = next(e for e in failures.exceptions if isinstance(e, SourceError))
        if failure is not None:  # raised above, Python 3.11.2 would wrap it
            raise failure

    async def _listen(self, intake: Intake) -> None:
        s = self.settings
        intake.opened()
        async with listening(s.host, s.bind, s.egm_port, self.inlet.account, intake.take):
            await asyncio.get_running_loop().create_future()

    async def _ask(self, controller: Controller) -> None:
        """Read pages; after a failure try again, later each time, as long as EGM goes on."""
        pause = 1.0
        while True:
            before = controller.taken
            try:
                async with session(self._access()) as web:
                    identity = await controller.identify(web)
                    self._greet(identity)
                    await controller.poll(web)
            except SourceError as failure:
                pause = 1.0 if controller.taken > before else min(2 * pause, _LONGEST_PAUSE)
                self.inlet.account.count("web failures")
                if str(failure) != str(self._trouble):
                    self.inlet.event("web_failed", f"{self.name}: {failure}")
                self._trouble = failure
                if self._intake is None:
                    raise
                await asyncio.sleep(pause)

    async def _watch(self) -> None:
        """End the run when neither EGM nor the pages have answered for the time-out."""
        while True:
            polls = self._controller.taken if self._controller else 0
            await asyncio.sleep(min(_CHECK, self.settings.timeout / 4))
            if self._controller is not None and self._controller.taken > polls:
                self._heard = time.monotonic()
            silence = time.monotonic() - self._heard
            if silence > self.settings.timeout + (1 / self.settings.web_rate if self._controller else 0.0):
                raise self._trouble or self._silence(silence)

    def _delivers(self) -> None:
        self._heard = time.monotonic()
        if not self._greeted:
            self._greet(_listened())

    def _greet(self, identity: Identity) -> None:
        self._greeted = True
        self._heard = time.monotonic()
        self.inlet.connected(identity)

    def _silence(self, seconds: float) -> ConnectError:
        s = self.settings
        return ConnectError(
            f"no EGM packet from {s.host} at UDP port {s.egm_port} for {seconds:.1f} s; check that RAPID has run "
            "EGMStreamStart, and the remote address, port and firewall of its UDPUC device"
        )

    def _access(self) -> Access:
        s = self.settings
        tls = s.tls if s.tls is not None else s.robotware == 7
        port = s.port or {6: 80, 7: 443}[s.robotware]
        return Access(s.host, port, s.robotware, s.user, s.password.get_secret_value(), tls, s.certificate, s.timeout)


def _listened() -> Identity:
    return Identity("ABB", "EGM stream")
