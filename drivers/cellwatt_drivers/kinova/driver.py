"""Polls a Kinova arm over Modbus TCP."""

from __future__ import annotations

import time
from contextlib import AbstractAsyncContextManager

from pydantic import Field, field_validator

from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.errors import SourceError
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt.slots import Slots
from cellwatt_drivers.kinova import registers
from cellwatt_drivers.kinova.registers import Block, Read, Turns
from cellwatt_drivers.shared.choice import Chosen
from cellwatt_drivers.shared.modbus import Bus, TcpPlace, line
from cellwatt_drivers.shared.polling import deliver, keep_conversing, reason_of
from cellwatt_drivers.shared.requirements import require
from cellwatt_drivers.shared.states import State, StateWatch

_ADVICE = "check the address, and that the arm's Modbus server is on (web application, Configurations, Networks)"


class KinovaSettings(SourceSettings):
    """A Gen3 (6 or 7 joints) or Gen3 lite."""

    host: Host = "192.168.1.10"
    """Address of the arm."""
    port: int = Field(registers.PORT, ge=1, le=65535)
    """TCP port."""
    unit: int = Field(1, ge=0, le=255)
    """Modbus unit number of the arm."""
    axes: int = Field(7, ge=6, le=7)
    """Number of joints of the arm."""
    read: Chosen[Block] = ("arm", "joints")
    """Groups to read: ``arm`` (supply, temperatures, state), ``joints``, ``tool``; at most two requests per poll."""
    rate: Hertz = Field(40.0, le=500)
    """Polls per second, at most 500."""
    timeout: Seconds = Field(0.5, gt=0)
    """Longest wait for an answer; after it the connection is opened again."""

    @field_validator("read")
    @classmethod
    def _with_joints(cls, value: tuple[Block, ...]) -> tuple[Block, ...]:
        if "tool" in value and "joints" not in value:
            raise ValueError("'tool' comes in one request with the joints: add 'joints' to read")
        return value


class KinovaDriver(Driver[KinovaSettings]):
    """One arm. A slot falls due ``rate`` times a second; one request per slot reads each block."""

    Settings = KinovaSettings
    libraries = ("pymodbus.client",)
    title = "Kinova Gen3 and Gen3 lite over Modbus TCP"
    emulator = "cellwatt_drivers.kinova.emulator:KinovaEmulator"
    writes = ("Modbus: read requests only (function 4): input registers 0 to 13, and 34 to 103 or 139",)

    def __init__(self, name: str, settings: KinovaSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        require(name, "driver kinova", {"pymodbus": "the package pymodbus"}, "pip install 'cellwatt[modbus]'")
        self._reads: tuple[Read, ...] = (registers.arm(settings.rate),) if "arm" in settings.read else ()
        if "joints" in settings.read:
            self._reads += (registers.joints(settings.rate, settings.axes, "tool" in settings.read),)
        self._slots = Slots(settings.rate, lambda n, reason: inlet.account.lose(n * len(self._reads), reason))
        self._turns = Turns()
        self._last: dict[str, list[int]] = {}
        states = {"robot.state": State("state", name, registers.STATES, "unknown")}
        for kind in ("fault", "warning"):
            states[f"robot.{kind}_flags"] = State(kind, f"{name}: {kind} flags", {}, digits=_flags)
        self._watches = {read.stream.name: StateWatch(inlet, read.stream, states) for read in self._reads}

    @property
    def streams(self) -> tuple[Stream, ...]:
        """``arm`` and ``motion``, if selected."""
        return tuple(read.stream for read in self._reads)

    async def identify(self) -> Identity:
        """Identify the arm by its registers, because Modbus gives no name. Raises ``SourceError``."""
        async with self._open() as modbus:
            return await self._greet(modbus)

    async def run(self) -> None:
        """See ``Driver.run``. A connection that has delivered samples is reopened at once, any other raises."""
        await keep_conversing(self, self._converse)

    def _open(self) -> AbstractAsyncContextManager[Bus]:
        return line(TcpPlace(self.settings.host, self.settings.port, "tcp", _ADVICE))

    async def _greet(self, modbus: Bus) -> Identity:
        async with modbus.turn(self.settings.timeout):
            for read in self._reads:
                await modbus.read("input", read.first, read.count, self.settings.unit)
        return Identity("Kinova", f"Gen3, {self.settings.axes} joints as set")

    async def _converse(self) -> None:
        """Run one connection, from the greeting on."""
        async with self._open() as modbus:
            self.inlet.connected(await self._greet(modbus))
            async with self._slots as slots:
                async for _ in slots:
                    for done, read in enumerate(self._reads):
                        await self._serve(modbus, read, len(self._reads) - done)

    async def _serve(self, modbus: Bus, read: Read, remaining: int) -> None:
        """Send one request; if it fails, the ``remaining`` requests of this slot are counted as missed."""
        try:
            async with modbus.turn(self.settings.timeout):
                answer = await modbus.read("input", read.first, read.count, self.settings.unit)
                arrival = self.inlet.now()
                asked = arrival - time.monotonic_ns() + modbus.asked
        except SourceError as error:
            self.inlet.account.lose(remaining, reason_of(error))
            raise
        self._emit(read, answer, asked, arrival)

    def _emit(self, read: Read, answer: list[int], asked: int, arrival: int) -> None:
        name = read.stream.name
        if answer == self._last.get(name):
            self.inlet.account.count(f"{name} repeats")
        self._last[name] = answer
        if name == "arm":
            values = registers.arm_values(answer)
        else:
            axes = self.settings.axes
            values = registers.motion_values(answer, axes)
            values[:axes] = self._turns.unwrap(values[:axes])
        deliver(self.inlet, read.stream, values, asked, arrival)
        self._watches[name].see(values.reshape(1, -1))


def _flags(value: float) -> str:
    return f"0x{int(value):08x}"
