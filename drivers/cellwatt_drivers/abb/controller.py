"""Polls a controller's pages: states and energy, a stream each; the caller pauses after a failure."""

from __future__ import annotations

import numpy as np

from cellwatt.channel import Channel, Quality, Stream
from cellwatt.driver import Identity, Inlet
from cellwatt.errors import DeviceError, ProtocolError, SourceError, WrongDeviceError
from cellwatt.slots import Slots
from cellwatt_drivers.abb import rws
from cellwatt_drivers.abb.settings import AbbSettings
from cellwatt_drivers.abb.web import Web
from cellwatt_drivers.shared.polling import deliver

STATE_CHANNELS = tuple(
    Channel(f"controller.{name}", "1", "discrete")
    for name in ("motors_on", "program_running", "automatic", "emergency_stop", "speed_ratio")
)


def energy_stream(axes: int) -> Stream:
    """Stream of the controller's energy measurement; a sample is due only when there is a new measurement."""
    return Stream(
        "energy",
        (
            Channel("controller.energy", "J", "counter"),
            Channel("controller.interval_energy", "J", "discrete"),
            Channel("controller.interval", "s", "discrete"),
            *(Channel(f"joint_{i}.interval_energy", "J", "discrete") for i in range(1, axes + 1)),
        ),
        0.0,
        "host",
    )


class Controller:
    """Polls those pages of a controller that its settings select.

    A poll reads the pages of both streams one after the other. Energy is handed over when the controller has a new
    measurement. ``polls`` counts polls.
    """

    def __init__(self, inlet: Inlet, settings: AbbSettings) -> None:
        self.polls = 0
        self._inlet = inlet
        self._settings = settings
        states = Stream("controller", STATE_CHANNELS, settings.web_rate, "host")
        self._state = states if "state" in settings.web else None
        self._energy = energy_stream(settings.axes) if "energy" in settings.web else None
        self._count: int | None = None
        self._valid = True
        self._before: dict[str, str] = {}
        self._slots = Slots(settings.web_rate, self._miss_slots)

    @property
    def streams(self) -> list[Stream]:
        """``controller`` and ``energy``, if selected."""
        return [stream for stream in (self._state, self._energy) if stream is not None]

    async def identify(self, web: Web) -> Identity:
        """Read name and version of the system."""
        values: dict[str, str] = {}
        for item in rws.items(await web.get(rws.SYSTEM)):
            values = {**item.values, **values}
        return Identity(
            "ABB",
            {6: "IRC5", 7: "OmniCore"}[self._settings.robotware],
            serial=values.get("sysid", ""),
            firmware=f"RobotWare {values.get('rwversion', 'unknown')}",
            notes={"system": values["name"]} if "name" in values else {},
        )

    async def poll(self, web: Web) -> None:
        """Read the pages in each slot until one cannot be read (``SourceError``)."""
        energy = self._energy
        async with self._slots as slots:
            async for _ in slots:
                if self._state is not None:
                    await self._read_state(web, self._state)
                if energy is not None and not await self._has_energy(web, energy):
                    energy = None
                self.polls += 1

    def _miss_slots(self, slots: int, reason: str) -> None:
        if self._state is not None:
            self._inlet.account.lose(slots, reason)

    async def _read_state(self, web: Web, stream: Stream) -> None:
        asked = self._inlet.now()
        try:
            words = {
                "controller": rws.value(await web.get(rws.CONTROLLER[self._settings.robotware]), "ctrlstate"),
                "program": rws.value(await web.get(rws.EXECUTION), "ctrlexecstate"),
                "mode": rws.value(await web.get(rws.MODE), "opmode"),
            }
            ratio = rws.ratio(await web.get(rws.SPEED))
        except SourceError:
            self._inlet.account.lose(1, "not answered")
            raise
        self._report(words)
        values = [
            float(words["controller"] == "motoron"),
            float(words["program"] == "running"),
            float(words["mode"] == "AUTO"),
            float(words["controller"].startswith("emergencystop")),
            ratio,
        ]
        deliver(self._inlet, stream, np.array(values), asked, self._inlet.now())

    async def _has_energy(self, web: Web, stream: Stream) -> bool:
        """Read the energy page; if the controller has none, return false: its other pages are still read."""
        try:
            await self._read_energy(web, stream)
        except (DeviceError, ProtocolError, WrongDeviceError) as error:
            if self._state is None:
                raise
            lacks = f"the controller has no energy page ({rws.ENERGY}); 'web: [state]' does not read it"
            reason = lacks if isinstance(error, WrongDeviceError) else str(error)
            self._inlet.event("energy_failed", f"energy is no longer read in this session: {reason}")
            return False
        return True

    async def _read_energy(self, web: Web, stream: Stream) -> None:
        asked = self._inlet.now()
        found = rws.energy(await web.get(rws.ENERGY), self._settings.mechanical_unit)
        if found.count == self._count:
            return
        if self._count is not None and found.count > self._count + 1:
            self._inlet.account.lose(found.count - self._count - 1, "energy between polls")
        self._count = found.count
        self._report({"energy": found.state})
        joints = len(stream.channels) - 3
        if len(found.joints) < joints:
            raise ProtocolError(
                f"the controller gives the energy of {len(found.joints)} axes of {self._settings.mechanical_unit}"
            )
        quality = Quality.GOOD if found.valid else Quality.MISSING
        if found.valid != self._valid:
            self._valid = found.valid
            kind, validity = ("energy_valid", "valid") if found.valid else ("energy_not_valid", "not valid")
            self._inlet.event(kind, f"the controller reports its energy measurement as {validity} ({found.state})")
        arrival = self._inlet.now()
        given = np.array([found.accumulated, found.interval_energy, *found.joints[:joints]])
        row = np.insert(given * self._settings.energy_unit, 2, found.interval)
        deliver(self._inlet, stream, row, asked, arrival, quality)

    def _report(self, words: dict[str, str]) -> None:
        """Report changed states."""
        for what, word in words.items():
            before = self._before.get(what, word)
            self._before[what] = word
            if before != word:
                self._inlet.event(f"{what}_state", f"{what}: {before} → {word}", before=before, after=word)
