"""Reads the meter: connect, poll at a steady rate, stamp, hand over."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import numpy as np
from pydantic import Field

from cellwatt import (
    Channel,
    ConnectError,
    Driver,
    Identity,
    Inlet,
    ProtocolError,
    Reading,
    SourceSettings,
    Stream,
    WrongDeviceError,
)
from cellwatt.errors import why
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt.slots import Slots
from cellwatt.testing.skeleton import wire

CHANNELS = (Channel("supply.voltage", "V"), Channel("supply.current", "A"), Channel("supply.power", "W"))


class SkeletonSettings(SourceSettings):
    """A meter on the network. This text and those below are its reference page."""

    host: Host
    """Address of the meter."""
    port: int = Field(wire.PORT, ge=1, le=65535)
    """TCP port of the meter."""
    rate: Hertz = 10.0
    """Samples per second."""
    timeout: Seconds = Field(1.0, gt=0)
    """Longest wait for an answer; after it the connection is opened again."""


class SkeletonDriver(Driver[SkeletonSettings]):
    """Reads one meter. Answers carry no number, so the driver reconnects after a late or malformed one."""

    Settings = SkeletonSettings
    title = "Skeleton: a meter over TCP"
    emulator = "cellwatt.testing.skeleton.emulator:SkeletonEmulator"
    writes = ("ID? on connecting", "READ? at the rate")

    def __init__(self, name: str, settings: SkeletonSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        self._stream = Stream("measured", CHANNELS, settings.rate, "host")
        self._slots = Slots(settings.rate, inlet.account.lose)

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The single stream ``measured``."""
        return (self._stream,)

    async def identify(self) -> Identity:
        """See ``Driver.identify``."""
        async with self._connected() as meter:
            return await self._greet(meter)

    async def run(self) -> None:
        """See ``Driver.run``. Each due poll is delivered, or counted as missed with its reason."""
        async with self._connected() as meter:
            self.inlet.connected(await self._greet(meter))
            async with self._slots as slots:
                async for _ in slots:
                    await self._poll(meter)

    async def _poll(self, meter: Meter) -> None:
        asked = self.inlet.now()
        try:
            sample = wire.parse_sample(await meter.ask(wire.READ))
        except ConnectError:
            self.inlet.account.lose(1, "no answer")
            raise
        except ProtocolError:
            self.inlet.account.lose(1, "malformed")
            raise
        values = np.array([[sample.voltage, sample.current, sample.power]])
        self.inlet.account.expect()
        self.inlet.emit(Reading(self._stream, values, self.inlet.now(), asked=asked))

    async def _greet(self, meter: Meter) -> Identity:
        try:
            serial, firmware = wire.parse_identity(await meter.ask(wire.WHO))
        except ProtocolError as error:
            raise WrongDeviceError(f"{meter.place} is not the meter: {error}") from error
        return Identity("", "meter", serial, firmware)

    @asynccontextmanager
    async def _connected(self) -> AsyncIterator[Meter]:
        """Open a connection. Raises ``ConnectError`` that says what to check."""
        s = self.settings
        place = f"{s.host}:{s.port}"
        try:
            async with asyncio.timeout(s.timeout):
                reader, writer = await asyncio.open_connection(s.host, s.port, limit=wire.LONGEST)
        except TimeoutError as error:
            raise ConnectError(f"{place} does not answer within {s.timeout:g} s: check address and cable") from error
        except OSError as error:
            raise ConnectError(f"{place} cannot be opened: {why(error)}") from error
        try:
            yield Meter(place, reader, writer, s.timeout)
        finally:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()


class Meter:
    """An open connection to the meter at ``place``; waits ``timeout`` s for an answer."""

    def __init__(self, place: str, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, timeout: float) -> None:
        self.place = place
        self._reader = reader
        self._writer = writer
        self._timeout = timeout

    async def ask(self, question: bytes) -> bytes:
        """Send a request; return its answer. Raises ``ConnectError`` without one, ``ProtocolError`` if too long."""
        try:
            self._writer.write(question)
            async with asyncio.timeout(self._timeout):
                return await self._reader.readuntil(b"\n")
        except TimeoutError as error:
            raise ConnectError(f"{self.place} gave no answer within {self._timeout:g} s") from error
        except asyncio.LimitOverrunError as error:
            raise ProtocolError(f"{self.place} sends without an end of line") from error
        except (OSError, asyncio.IncompleteReadError) as error:
            raise ConnectError(f"{self.place} closed the connection") from error
