"""Reads a Franka robot's state at 1 kHz through pylibfranka."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from cellwatt.channel import Stream
from cellwatt.driver import Driver, Identity, Inlet, SourceSettings
from cellwatt.host import Host
from cellwatt.quantity import Hertz, Seconds
from cellwatt_drivers.franka import library
from cellwatt_drivers.franka.fields import Group, Selection
from cellwatt_drivers.franka.intake import Intake
from cellwatt_drivers.shared.choice import Chosen, whole_part_of
from cellwatt_drivers.shared.requirements import require

FASTEST = 1000.0


class FrankaSettings(SourceSettings):
    """A Franka Research 3 (or Panda), over the Franka Control Interface."""

    host: Host
    """Address of the robot (its control unit)."""
    read: Chosen[Group] = ("joints", "motors", "external", "state")
    """Groups of each state to read."""
    rate: Annotated[Hertz, whole_part_of(FASTEST)] = FASTEST
    """States per second to read: 1 kHz divided by a whole number."""
    timeout: Seconds = Field(2.0, gt=0)
    """Silence after which the connection is closed and opened again."""


class FrankaDriver(Driver[FrankaSettings]):
    """One robot's states as one stream on the robot's clock; the library runs in its own process."""

    Settings = FrankaSettings
    title = "Franka robots over FCI (Research 3, Panda), through pylibfranka"
    emulator = "cellwatt_drivers.franka.emulator:FrankaEmulator"
    least_delay: ClassVar[tuple[float, float]] = (0.0, 0.002)  # a robot's cycle, and the transfer between processes
    writes = (
        "what pylibfranka's constructor sends over TCP 1337: connect (command 0) and getRobotModel (command 11)",
        "UDP: nothing; no control loop is ever started",
    )

    def __init__(self, name: str, settings: FrankaSettings, inlet: Inlet) -> None:
        super().__init__(name, settings, inlet)
        how = "pip install 'cellwatt[franka]' (Linux on x86-64, Python 3.11 or 3.12)"
        require(name, "franka", {"pylibfranka": "the package pylibfranka"}, how)
        self._selection = Selection.of(settings.read)
        self._every = round(FASTEST / settings.rate)
        stream = Stream("fci", self._selection.channels, settings.rate, "device")
        self._intake = Intake(inlet, stream, self._every)

    @property
    def streams(self) -> tuple[Stream, ...]:
        """The one stream, ``fci``."""
        return (self._intake.stream,)

    async def run(self) -> None:
        """See ``Driver.run``."""
        s = self.settings
        self._intake.opened()
        async with library.reading(s.host, self._every, self._selection, s.timeout) as reader:
            block = await reader.block()
            self.inlet.connected(_identity(reader))
            try:
                while True:
                    self._intake.take(block[:, 0].astype(np.int64), block[:, 1], block[:, 2:])
                    block = await reader.block()
            finally:
                self._intake.settle()

    async def identify(self) -> Identity:
        """See ``Driver.identify``: the library does not give the robot's name, only its states."""
        s = self.settings
        async with library.reading(s.host, self._every, self._selection, s.timeout) as reader:
            await reader.block()
            return _identity(reader)


def _identity(reader: library.Reader) -> Identity:
    priority = "real-time" if reader.real_time else "ordinary: a busy PC loses states"
    notes = {"client": "pylibfranka", "priority of the reader": priority}
    return Identity("Franka Robotics", "FCI robot with 7 joints", notes=notes)
