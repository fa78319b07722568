"""Drivers that break the contract, each in one way; all else they have from the skeleton."""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import field_validator

from cellwatt import Identity, Reading, SourceError, SourceSettings
from cellwatt.testing import Rig
from cellwatt.testing.skeleton import SkeletonDriver, SkeletonSettings, wire
from cellwatt.testing.skeleton.driver import Meter
from cellwatt.testing.skeleton.emulator import SkeletonEmulator

SETTINGS = {"rate": "50 Hz", "timeout": "1 s"}
IMPATIENT = SETTINGS | {"timeout": "200 ms"}
ALLOWED = re.compile(rb"(?:ID\?\n|READ\?\n)*").fullmatch


def rig(driver: type[SkeletonDriver], **changes: Any) -> Rig:
    """The skeleton's rig with another driver; it gives up after 3 s, for what never comes."""
    settings = IMPATIENT if driver is MapsNothing else SETTINGS  # a delay of the device must outlast its time-out
    return replace(Rig(driver, settings, may_send=ALLOWED, patience=3.0), **changes)


# the emulator -----------------------------------------------------------------------------------------


class FailingEmulator(SkeletonEmulator):
    async def serve(self, ready):
        try:
            await super().serve(ready)
        finally:
            raise KeyError("a mistake")


class HasAnEmulatorThatFails(SkeletonDriver):
    emulator = f"{__name__}:FailingEmulator"


# settings ---------------------------------------------------------------------------------------------


class TakesAnyValue(SkeletonDriver):
    class Settings(SkeletonSettings):
        """A meter."""

        timeout: float = 0.2
        """Time-out, s."""

        @field_validator("timeout", mode="before")
        @classmethod
        def _any(cls, value: Any) -> float:
            return value if isinstance(value, float) else 0.2


class SaysNothingOfAKey(SkeletonDriver):
    class Settings(SourceSettings):
        """A meter."""

        host: str
        port: int = 1
        rate: float = 10.0
        timeout: float = 1.0


# start and stop ---------------------------------------------------------------------------------------


class DeclaresNothingItSends(SkeletonDriver):
    writes = "READ?"  # type: ignore[assignment]


class Returns(SkeletonDriver):
    async def run(self) -> None:
        async with self._connected() as meter:
            self.inlet.connected(await self._greet(meter))


class NeverSaysConnected(SkeletonDriver):
    async def run(self) -> None:
        async with self._connected() as meter:
            while True:
                await self._poll(meter)
                await asyncio.sleep(0.02)


class CountsNothing(SkeletonDriver):
    async def _poll(self, meter: Meter) -> None:
        sample = wire.parse_sample(await meter.ask(wire.READ))
        values = np.array([[sample.voltage, sample.current, sample.power]])
        self.inlet.emit(Reading(self._stream, values, self.inlet.now()))


class GoesOnAfterTheEnd(SkeletonDriver):
    async def run(self) -> None:
        self.task = asyncio.create_task(super().run())
        await asyncio.shield(self.task)


class LeavesTheSocketOpen(SkeletonDriver):
    kept: tuple = ()

    async def run(self) -> None:
        LeavesTheSocketOpen.kept += (await asyncio.open_connection(self.settings.host, self.settings.port),)
        await super().run()


# cancellation -----------------------------------------------------------------------------------------


class SwallowsCancellation(SkeletonDriver):
    async def run(self) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            await super().run()


# reconnect --------------------------------------------------------------------------------------------


class LeaksOsErrors(SkeletonDriver):
    @contextlib.asynccontextmanager
    async def _connected(self):
        s = self.settings
        reader, writer = await asyncio.open_connection(s.host, s.port)
        try:
            yield Meter("meter", reader, writer, s.timeout)
        finally:
            writer.close()


class DoesNotSayWhere(SkeletonDriver):
    @contextlib.asynccontextmanager
    async def _connected(self):
        try:
            async with super()._connected() as meter:
                yield meter
        except SourceError as error:
            raise type(error)("cannot connect") from None


# stamps -----------------------------------------------------------------------------------------------


class Restamps(SkeletonDriver):
    """Hands on readings of the skeleton, changed by ``stamped``."""

    def __init__(self, name, settings, inlet):
        super().__init__(name, settings, inlet)
        emit = inlet.emit
        inlet.emit = lambda reading: emit(self.stamped(reading))

    def stamped(self, reading: Reading) -> Reading:
        raise NotImplementedError


class AsksAfterTheAnswer(Restamps):
    def stamped(self, reading: Reading) -> Reading:
        return replace(reading, asked=reading.arrival + 1)


class StampsFromOneProcessStart(Restamps):
    def stamped(self, reading: Reading) -> Reading:
        return replace(reading, arrival=time.monotonic_ns(), asked=None)


class OnDeviceTime(Restamps):
    def __init__(self, name, settings, inlet):
        super().__init__(name, settings, inlet)
        self._stream = replace(self._stream, clock="device")


class CountsMicroseconds(OnDeviceTime):
    def stamped(self, reading: Reading) -> Reading:
        return replace(reading, device_time=np.array([time.monotonic_ns() // 1000]))


class StandsStill(OnDeviceTime):
    def stamped(self, reading: Reading) -> Reading:
        return replace(reading, device_time=np.array([7]))


# rates, values, writes, loop --------------------------------------------------------------------------


class PollsTooSlowly(SkeletonDriver):
    def __init__(self, name, settings, inlet):
        super().__init__(name, settings.model_copy(update={"rate": settings.rate / 2}), inlet)
        self._stream = replace(self._stream, rate=settings.rate)


class GivesMilliwatts(Restamps):
    def stamped(self, reading: Reading) -> Reading:
        return replace(reading, values=reading.values * [1.0, 1.0, 1000.0])


class SwitchesTheLoad(SkeletonDriver):
    async def _greet(self, meter: Meter) -> Identity:
        meter._writer.write(b"OUTPUT OFF\n")
        return await super()._greet(meter)


class Blocks(SkeletonDriver):
    async def _greet(self, meter: Meter) -> Identity:
        time.sleep(0.8)  # noqa: ASYNC251 - the very mistake
        return await super()._greet(meter)


# faults -----------------------------------------------------------------------------------------------


class RawMeter(Meter):
    async def ask(self, question: bytes) -> bytes:
        self._writer.write(question)
        return await asyncio.wait_for(self._reader.readuntil(b"\n"), self._timeout)


class MapsNothing(SkeletonDriver):
    """Raises what the library raises; dies of every fault."""

    @contextlib.asynccontextmanager
    async def _connected(self):
        async with super()._connected() as meter:
            yield RawMeter(meter.place, meter._reader, meter._writer, meter._timeout)

    async def _poll(self, meter: Meter) -> None:
        voltage, current, milliwatt = (float(x) for x in (await meter.ask(wire.READ)).split())
        self.inlet.account.expect()
        values = np.array([[voltage, current, milliwatt / 1000.0]])
        self.inlet.emit(Reading(self._stream, values, self.inlet.now()))


class SwallowsLoss(SkeletonDriver):
    """Asks again and counts nothing."""

    async def run(self) -> None:
        async with self._connected() as meter:
            self.inlet.connected(await self._greet(meter))
            while True:
                with contextlib.suppress(SourceError):
                    sample = wire.parse_sample(await meter.ask(wire.READ))
                    self.inlet.account.expect()
                    values = np.array([[sample.voltage, sample.current, sample.power]])
                    self.inlet.emit(Reading(self._stream, values, self.inlet.now()))
                await asyncio.sleep(0.02)
