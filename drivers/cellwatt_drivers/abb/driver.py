"""Listens to an ABB controller's EGM stream and reads its web pages."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Collection
from typing import ClassVar

from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet
from cellwatt.errors import ConnectError, SourceError
from cellwatt.together import until_one_ends
from cellwatt_drivers.abb import wire
from cellwatt_drivers.abb.controller import Controller
from cellwatt_drivers.abb.egm import listening
from cellwatt_drivers.abb.intake import Intake
from cellwatt_drivers.abb.settings import AbbSettings
from cellwatt_drivers.abb.web import session
from cellwatt_drivers.shared.requirements import require

_INSTALL = "pip install 'cellwatt[abb]'"
_LONGEST_PAUSE = 30.0  # s between attempts to read web pages after a failure
_LISTENED = Identity("ABB", "EGM stream")
_CHECK = 0.25  # s between checks for incoming data


class AbbDriver(Driver[AbbSettings]):
    """One robot. EGM and the web pages work independently; the source is down when neither answers."""

    Settings = AbbSettings
    libraries = ("aiohttp", "google.protobuf.message_factory")
    title = "ABB robots over EGM and Robot Web Services (IRC5, OmniCore)"
    emulator = "cellwatt_drivers.abb.emulator:AbbEmulator"
    least_delay: ClassVar[tuple[float, float]] = (0.0, 0.02)  # that of a measurement in the controller is unknown
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
            found = wire.columns(settings.egm, settings.axes, settings.external, settings.robotware, settings.linear)
            stream = Stream("egm", found.channels, settings.rate, "device")
            self._intake = Intake(inlet, stream, found, self._delivers)
            self.rates = self._intake.rates
            streams.append(stream)
        if settings.web:
            require(name, "web", {"aiohttp": "the package aiohttp"}, f"{_INSTALL}, or set web: []")
            self._controller = Controller(inlet, settings)
            streams += self._controller.streams
        self._streams = tuple(streams)
        self._greeted = False
        self._last_data = 0.0
        self._web_failure: SourceError | None = None
        self._strangers: Collection[str] = ()

    @property
    def streams(self) -> tuple[Stream, ...]:
        """``egm``, ``controller`` and ``energy``, if selected."""
        return self._streams

    async def identify(self) -> Identity:
        """Identify the controller by its pages or, if they are not read, by received EGM packets."""
        if self._controller is not None:
            async with session(self.settings) as web:
                return await self._controller.identify(web)
        s = self.settings
        come = asyncio.Event()
        port = listening(s.host, s.bind, s.egm_port, self.inlet.account, lambda *_: come.set())
        async with port as self._strangers:
            try:
                async with asyncio.timeout(s.timeout):
                    await come.wait()
            except TimeoutError:
                raise self._silence(s.timeout) from None
        return _LISTENED

    async def run(self) -> None:
        """See ``Driver.run``."""
        self._last_data = time.monotonic()
        self._greeted = False
        self._web_failure = None
        works = [self._watch()]
        if self._intake is not None:
            works.append(self._listen(self._intake))
        if self._controller is not None:
            works.append(self._ask(self._controller))
        await until_one_ends(*works)

    async def _listen(self, intake: Intake) -> None:
        s = self.settings
        intake.opened()
        async with listening(s.host, s.bind, s.egm_port, self.inlet.account, intake.take) as self._strangers:
            await asyncio.get_running_loop().create_future()

    async def _ask(self, controller: Controller) -> None:
        """Read pages; after a failure retry at growing intervals, as long as EGM delivers."""
        pause = 1.0
        while True:
            before = controller.polls
            try:
                async with session(self.settings) as web:
                    identity = await controller.identify(web)
                    self._greet(identity)
                    await controller.poll(web)
            except SourceError as failure:
                pause = 1.0 if controller.polls > before else min(2 * pause, _LONGEST_PAUSE)
                self.inlet.account.count("web failures")
                if str(failure) != str(self._web_failure):
                    self.inlet.event("web_failed", f"{self.name}: {failure}")
                self._web_failure = failure
                if self._intake is None:
                    raise
                await asyncio.sleep(pause)

    async def _watch(self) -> None:
        """End the run when neither EGM nor the pages have answered for the time-out."""
        while True:
            polls = self._controller.polls if self._controller else 0
            await asyncio.sleep(min(_CHECK, self.settings.timeout / 4))
            if self._controller is not None and self._controller.polls > polls:
                self._last_data, self._web_failure = time.monotonic(), None
            silence = time.monotonic() - self._last_data
            if silence > self.settings.timeout + (1 / self.settings.web_rate if self._controller else 0.0):
                raise self._web_failure or self._silence(silence)

    def _delivers(self) -> None:
        self._last_data = time.monotonic()
        if not self._greeted:
            self._greet(_LISTENED)

    def _greet(self, identity: Identity) -> None:
        self._greeted = True
        self._last_data = time.monotonic()
        self.inlet.connected(identity)

    def _silence(self, seconds: float) -> ConnectError:
        s = self.settings
        what = f"no EGM packet from {s.host} at UDP port {s.egm_port} for {seconds:.1f} s"
        if others := ", ".join(self._strangers):
            return ConnectError(f"{what}; {others} sends to that port: is it this robot's address?")
        if self._intake is not None and self._intake.refused:
            return ConnectError(f"{what}, but other data from it: {self._intake.refused}")
        return ConnectError(
            f"{what}; check that RAPID has run EGMStreamStart, and the remote address, port and firewall of its UDPUC "
            "device"
        )
