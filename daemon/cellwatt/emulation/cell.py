"""The emulated devices of a cell: a process for each device, one motion and one epoch for all."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from cellwatt.config import CellConfig, SourceConfig
from cellwatt.config.places import KeyPath
from cellwatt.config.wording import did_you_mean
from cellwatt.driver import SourceSettings
from cellwatt.emulation.emulator import Emulator
from cellwatt.emulation.process import EmulatorProcess
from cellwatt.emulation.words import WORLD, addressed, kind_of, kinds_of, mishap
from cellwatt.errors import ConfigError, Problem
from cellwatt.host import stays_here
from cellwatt.registry import driver as find_driver


@dataclass(frozen=True, slots=True)
class Device:
    """A device to emulate and the sources that read it: several if they share an address, like meters on one line.

    The emulator listens at ``listen``; ``there`` is the device's address in the settings.
    """

    driver: str
    sources: tuple[SourceConfig, ...]
    there: str
    listen: str
    options: Mapping[str, str] = field(default_factory=dict)
    speed: float = 1.0

    @property
    def name(self) -> str:
        """Name of its first source."""
        return self.sources[0].name

    @property
    def emulator(self) -> type[Emulator]:
        """Class of its emulator."""
        return emulator_of(self.driver)

    @property
    def is_here(self) -> bool:
        """True if the device's address in the settings is a loopback address, or a path outside /dev."""
        if self.there.startswith("/"):
            return not self.there.startswith("/dev/")
        return stays_here(self.there.rpartition(":")[0])

    def process(self, epoch: float, seed: int, faults: Sequence[str] = ()) -> EmulatorProcess:
        """Create its process without starting it."""
        words = [w for key, value in self.options.items() for w in ("--option", f"{key}={value}")]
        words += [w for fault in faults for w in ("--fault", fault)]
        world = ("--epoch", repr(epoch), "--speed", repr(self.speed), "--seed", str(seed))
        return EmulatorProcess(self.driver, "--listen", self.listen, *world, *words)


def places(devices: Sequence[Device], emulators: Mapping[str, EmulatorProcess]) -> dict[KeyPath, Any]:
    """Settings of all sources that must change to read the running emulators, by key path in the cell's file."""
    return {
        ("sources", source.name, key): value
        for device in devices
        for source in device.sources
        for key, value in device.emulator.settings_at(emulators[device.name].address, source.settings).items()
    }


def emulator_of(driver: str) -> type[Emulator]:
    """Emulator class of a driver. Raises ``ConfigError`` for an unknown driver."""
    found: type[Emulator] = resolve_name(find_driver(driver).emulator)
    return found


def devices_of(
    config: CellConfig, *, free: bool = False, links: Path | None = None, speeds: Mapping[str, float] | None = None
) -> list[Device]:
    """Devices that a cell's sources read; each listens at its address in the settings, or with ``free`` at a free one.

    With ``free``, a device at a serial line listens at a link whose path is ``links``, a hyphen and the source's name;
    without ``links``, at the pseudo-terminal's own path. ``speeds`` are the speeds of the arms' motion, by source.
    Raises ``ConfigError`` that lists every source whose device cannot be emulated.
    """
    shared: dict[tuple[str, str], list[SourceConfig]] = {}
    problems, devices = [], []
    for source in config.sources.values():
        try:
            there = emulator_of(source.driver).address_in(source.settings)
        except ValueError as error:
            problems.append(Problem(source.place, f"sources.{source.name}", str(error)))
        else:
            shared.setdefault((source.driver, there), []).append(source)
    for (driver, there), sources in shared.items():
        first, emulator = sources[0], emulator_of(driver)
        try:
            listen = _free(emulator, first.name, first.settings, links) if free else there
            options = emulator.options_for([source.settings for source in sources])
        except ValueError as error:
            problems.append(Problem(first.place, f"sources.{first.name}", f"its device is not emulated: {error}"))
        else:
            speed = (speeds or {}).get(first.name, 1.0)
            devices.append(Device(driver, tuple(sources), there, listen, options, speed))
    if problems:
        raise ConfigError(problems)
    return devices


def _free(emulator: type[Emulator], name: str, settings: SourceSettings, links: Path | None) -> str:
    address = emulator.free_address(settings)
    return f"{links}-{name}" if address == "pty" and links is not None else address


def faults_by_device(texts: Sequence[str], devices: Sequence[Device]) -> dict[str, list[str]]:
    """Faults in words, by the device that they strike; faults of the world strike all devices.

    Raises ``ConfigError`` for a fault that cannot be parsed, or that does not name its device.
    """
    found: dict[str, list[str]] = {device.name: [] for device in devices}
    by_source = {source.name: device for device in devices for source in device.sources}
    for text in texts:
        try:
            for device in targets(text, by_source):
                words = addressed(text)[1]
                mishap(words, device.emulator)
                found[device.name].append(words)
        except ValueError as error:
            raise ConfigError(str(error)) from error
    return found


def targets(text: str, by_source: Mapping[str, Device]) -> list[Device]:
    """Devices that a fault in words strikes. Raises ``ValueError`` if the fault does not name its device."""
    names, words = addressed(text)
    for name in names:
        if name not in by_source:
            raise ValueError(f"found the source {name!r} in the fault {text!r}, expected {', '.join(by_source)}")
    devices = list({device.name: device for device in by_source.values()}.values())
    kind, known = kind_of(words), {kind for device in devices for kind in kinds_of(device.emulator)}
    if kind not in known:
        raise ValueError(f"no device here has a fault {kind!r}{did_you_mean(kind, known)}")
    if names:
        return [device for device in devices if any(by_source[name] is device for name in names)]
    if len(devices) > 1 and kind not in WORLD:
        named = ", ".join(by_source)
        raise ValueError(
            f"found {text!r} as a fault, expected its source first, like {next(iter(by_source))}/{words}"
            f" (sources: {named}; only {' and '.join(WORLD)} strike all)"
        )
    return devices


@contextlib.asynccontextmanager
async def running(
    devices: Sequence[Device], epoch: float, *, seed: int = 0, faults: Mapping[str, Sequence[str]] | None = None
) -> AsyncIterator[dict[str, EmulatorProcess]]:
    """Run each device's emulator in its own process, by device name; the motion starts at ``epoch``, UTC s.

    Raises ``CellwattError`` if one does not start; the others are then stopped.
    """
    async with contextlib.AsyncExitStack() as stack:
        made = {
            device.name: device.process(epoch, seed + number, (faults or {}).get(device.name, ()))
            for number, device in enumerate(devices)
        }
        entering = (stack.enter_async_context(emulator) for emulator in made.values())
        for outcome in await asyncio.gather(*entering, return_exceptions=True):
            if isinstance(outcome, BaseException):
                raise outcome
        for emulator in made.values():
            emulator.be_punctual()
        yield made
