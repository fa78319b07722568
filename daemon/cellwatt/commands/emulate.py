"""``cellwatt emulate``: emulates one device, or all devices of a cell."""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path
from typing import Any

import click

from cellwatt.commands import EXISTING, EXIT_ERROR, FILE
from cellwatt.commands.emulate_cell import emulate_cell
from cellwatt.commands.options import FINITE, POSITIVE
from cellwatt.emulation import ArmSignals, Emulator, Fault, Signals, load_signals
from cellwatt.emulation.cell import emulator_of
from cellwatt.emulation.control import answers, say
from cellwatt.emulation.words import Mishap, addressed, mishap
from cellwatt.errors import CellwattError, ConfigError, why
from cellwatt.processor import RunDelay

_ONE_DEVICE = {"address": "--listen", "recording": "--recording", "loop": "--loop", "options": "--option"}


@click.command(short_help="Emulate devices and their faults.")
@click.argument("driver", required=False)
@click.option(
    "--cell",
    type=EXISTING,
    help="Emulate all devices of this settings file, with the same moving arm, instead of one DRIVER's device.",
)
@click.option(
    "--write",
    type=FILE,
    help="Listen at free addresses, and write a copy of the settings of --cell with these addresses.",
)
@click.option(
    "--listen", "address", default="", help="Address: HOST:PORT (port 0: any free port), pty, or path of a link to it."
)
@click.option("--recording", type=EXISTING, help="Serve this CSV or Parquet file instead of the built-in arm.")
@click.option("--loop", is_flag=True, help="Restart the recording at its end.")
@click.option("--speed", type=POSITIVE, default=1.0, show_default=True, help="Speed of the built-in arm.")
@click.option("--epoch", type=FINITE, help="UTC time, s, at which the signals start (default: now).")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of noise and faults.")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="WORDS",
    help="A fault: spring:joint=3,at=20s; with --cell board/loss:probability=1%; may be repeated.",
)
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="Option of the emulator; repeatable.")
@click.option("--control", is_flag=True, help="Read JSON commands, one per line, from stdin until it ends.")
@click.pass_context
def command(
    context: click.Context,
    driver: str | None,
    cell: Path | None,
    write: Path | None,
    address: str,
    recording: Path | None,
    loop: bool,
    speed: float,
    epoch: float | None,
    seed: int,
    faults: tuple[str, ...],
    options: tuple[str, ...],
    control: bool,
) -> None:
    """Emulate the device that DRIVER connects to, or with --cell all devices of a cell."""
    if (driver is None) == (cell is None):
        raise click.UsageError("expected either a DRIVER, like 'ur', or --cell FILE")
    start = time.time() if epoch is None else epoch
    if cell is not None:
        for name, option in _ONE_DEVICE.items():
            if context.params[name]:
                raise click.UsageError(f"{option} is for one DRIVER, not for --cell")
        emulate_cell(cell, write, start, speed, seed, faults, control)
        return
    assert driver is not None
    if write is not None:
        raise click.UsageError("--write goes with --cell FILE")
    if recording is None and loop:
        raise click.UsageError("--loop goes with --recording FILE")
    if recording is not None and speed != 1:
        raise click.UsageError("--speed is that of the built-in arm, not of --recording")
    signals: Signals = ArmSignals(speed=speed, seed=seed) if recording is None else load_signals(recording, loop=loop)
    emulator_class = emulator_of(driver)
    try:
        pairs = dict(_pair(option) for option in options)
        emulator = emulator_class(signals, address, epoch=start, seed=seed, options=pairs)
        coming = [mishap(addressed(text)[1], emulator_class) for text in faults]
    except (ValueError, TypeError) as error:
        raise ConfigError(str(error)) from error
    try:
        asyncio.run(_serve(emulator, coming, control))
    except KeyboardInterrupt:
        sys.exit(130)


def _pair(option: str) -> tuple[str, str]:
    key, sign, value = option.partition("=")
    if not sign:
        raise ValueError(f"found {option!r} as an option, expected KEY=VALUE")
    return key, value


def begin(planned: Mishap, emulator: Emulator) -> None:
    """Start a fault or change. Raises ``ValueError`` if the device does not support it."""
    if isinstance(planned.what, Fault):
        emulator.inject(planned.what)
    else:
        emulator.disturb(planned.what)


async def _serve(emulator: Emulator, coming: list[Mishap], control: bool) -> None:
    try:
        for planned in coming:
            _begin_in_time(planned, emulator)
    except ValueError as refusal:
        raise ConfigError(str(refusal)) from refusal
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    await asyncio.wait((serving, ready), return_when=asyncio.FIRST_COMPLETED)
    if serving.done():
        error = serving.exception()
        if control:
            say({"error": f"{type(error).__name__}: {error}"})
            sys.exit(EXIT_ERROR)
        raise CellwattError(f"cannot listen: {why(error)}" if isinstance(error, OSError) else str(error))
    if not control:
        click.echo(f"{emulator.title} at {ready.result()} (Ctrl-C ends)")
        await serving
        return
    say({"ready": ready.result()})
    delay = RunDelay()

    async def answer(message: dict[str, Any]) -> dict[str, Any]:
        return _answer(emulator, message, delay)

    obeying = asyncio.create_task(answers(answer))
    await asyncio.wait((serving, obeying), return_when=asyncio.FIRST_COMPLETED)
    for task in (serving, obeying):
        task.cancel()
    for outcome in await asyncio.gather(serving, obeying, return_exceptions=True):
        if isinstance(outcome, Exception):
            raise outcome


def _begin_in_time(planned: Mishap, emulator: Emulator) -> None:
    """Start a fault or change when it is due. Raises ``ValueError`` if that is now and the device refuses it."""
    if (delay := emulator.epoch + planned.at - time.time()) > 0:
        asyncio.get_running_loop().call_later(delay, begin, planned, emulator)
    else:
        begin(planned, emulator)


def _answer(emulator: Emulator, message: dict[str, Any], delay: RunDelay) -> dict[str, Any]:
    match message:
        case {"fault": str(text)}:
            _begin_in_time(mishap(text, type(emulator)), emulator)
        case {"counts": _}:
            return {"counts": dict(emulator.counts)}
        case {"kept": _}:
            return {"kept": delay.look() * 1e-9}
        case _:
            raise ValueError("expected a fault in words, counts or kept")
    return {"ok": True}
