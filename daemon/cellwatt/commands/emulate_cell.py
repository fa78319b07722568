"""``cellwatt emulate --cell``: emulates all devices of a cell, which share one simulated arm."""

from __future__ import annotations

import asyncio
import json
import shlex
import signal
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import click
import yaml

from cellwatt.config import CellConfig, load
from cellwatt.config.places import KeyPath
from cellwatt.emulation import EmulatorProcess
from cellwatt.emulation.cell import Device, devices_of, faults_by_device, places, running
from cellwatt.emulation.control import answers, say
from cellwatt.errors import CellwattError, ConfigError
from cellwatt.files import read_bytes, write_file
from cellwatt.progress.terminal import show_table


def emulate_cell(
    file: Path, write: Path | None, epoch: float, speed: float, seed: int, faults: Sequence[str], control: bool
) -> None:
    """Emulate the devices of a settings file until SIGTERM, SIGINT or, with ``control``, the end of input.

    Raises ``CellwattError`` if a device cannot be emulated, or if its emulator ends by itself.
    """
    config = load(file)
    if write is not None and write.absolute().parent.resolve() != file.absolute().parent.resolve():
        raise ConfigError(f"found --write {write}, expected a file beside {file}, where its relative paths start")
    if write is not None and write.resolve() == file.resolve():
        raise ConfigError(f"found --write {write}, which is the cell's own file; expected another name")
    links = write.absolute().with_suffix("") if write is not None else None
    devices = devices_of(config, free=write is not None, links=links)
    if write is None:
        _check_here(file, devices)
    struck = faults_by_device(faults, devices)
    run = _run(config, [replace(d, speed=speed) for d in devices], write, epoch, seed, struck, control)
    if asyncio.run(run) == signal.SIGINT:
        raise click.Abort


def _check_here(file: Path, devices: Sequence[Device]) -> None:
    elsewhere = [f"{device.name} ({device.there})" for device in devices if not device.is_here]
    if elsewhere:
        copy = shlex.quote(str(file.with_name(f"{file.stem}-emulated.yaml")))
        raise ConfigError(
            f"{file}: not on this PC: {', '.join(elsewhere)}; add --write {copy}, a copy with local addresses"
        )


async def _run(
    config: CellConfig,
    devices: Sequence[Device],
    write: Path | None,
    epoch: float,
    seed: int,
    faults: Mapping[str, Sequence[str]],
    control: bool,
) -> int:
    """Serve until a signal or the end of input; return the signal's number, 0 for the end of input."""
    loop = asyncio.get_running_loop()
    asked: asyncio.Future[int] = loop.create_future()

    def note(number: int) -> None:
        if not asked.done():
            asked.set_result(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, note, number)
    async with running(devices, epoch, seed=seed, faults=faults) as emulators:
        if write is not None:
            _write(config, devices, emulators, write)
        file = write or config.path
        if control:
            say({"ready": {name: emulator.address for name, emulator in emulators.items()}})
        else:
            _show(file, devices, emulators)
        ends = {name: asyncio.create_task(emulator.ended()) for name, emulator in emulators.items()}
        waiting: list[asyncio.Future[Any]] = [asked, *ends.values()]
        if control:
            waiting.append(asyncio.create_task(answers(partial(_answer, devices, emulators))))
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        for name, end in ends.items():
            if end.done() and not asked.done():
                raise CellwattError(f"the emulator of {name} ended with exit code {end.result()}")
        for task in waiting[1:]:
            task.cancel()
        await asyncio.gather(*waiting[1:], return_exceptions=True)
    return asked.result() if asked.done() else 0


def _write(
    config: CellConfig, devices: Sequence[Device], emulators: Mapping[str, EmulatorProcess], write: Path
) -> None:
    """Write a copy of the settings with the addresses of the emulators, and check it by loading it."""
    changes = places(devices, emulators)
    write_file(write, _changed(read_bytes(config.path), changes))
    copy = load(write)
    for (_, name, key), value in changes.items():
        if getattr(copy.sources[str(name)].settings, str(key)) != value:
            shown = json.dumps(value)
            raise CellwattError(f"{write}: sources.{name}.{key} could not be set; write {key}: {shown} there")


def _changed(text: bytes, changes: Mapping[KeyPath, Any]) -> str:
    """The text of a settings file with ``changes`` applied; comments are lost, all else is unchanged."""
    root: Any = yaml.compose(text, Loader=yaml.SafeLoader)
    for (*where, key), value in changes.items():
        node = root
        for name in where:
            found = [inside for known, inside in node.value if known.value == name]
            if not found:
                raise CellwattError(f"{'.'.join(map(str, where))} is merged by '<<': write it out for --write")
            node = found[0]
        new: Any = yaml.compose(yaml.safe_dump({key: value}), Loader=yaml.SafeLoader)
        node.value = [*(pair for pair in node.value if pair[0].value != key), *new.value]
    return str(yaml.serialize(root, Dumper=yaml.SafeDumper, allow_unicode=True, width=float("inf")))


def _show(file: Path, devices: Sequence[Device], emulators: Mapping[str, EmulatorProcess]) -> None:
    rows = [(s.name, d.driver, d.emulator.title, emulators[d.name].address) for d in devices for s in d.sources]
    show_table(("source", "driver", "emulated device", "listens at"), rows)
    click.echo(f"next, in another terminal: cellwatt run {shlex.quote(str(file))} (Ctrl-C ends the devices)")


async def _answer(
    devices: Sequence[Device], emulators: Mapping[str, EmulatorProcess], message: dict[str, Any]
) -> Mapping[str, Any]:
    """Answer one command for the device of ``source``, or for all devices if ``source`` is absent.

    A fault whose words one device does not understand is applied to none.
    """
    source = message.get("source")
    match message:
        case {"fault": str(text)}:
            for name, faults in faults_by_device([text if source is None else f"{source}/{text}"], devices).items():
                for fault in faults:
                    await emulators[name].strike(fault)
            return {"ok": True}
        case {"counts": _}:
            by_source = {each.name: emulators[device.name] for device in devices for each in device.sources}
            if source is not None and source not in by_source:
                raise ValueError(f"found the source {source!r}, expected one of {', '.join(by_source)}")
            chosen = emulators if source is None else {source: by_source[source]}
            return {"counts": {name: await emulator.counts() for name, emulator in chosen.items()}}
    raise ValueError("expected a fault in words, or counts")
