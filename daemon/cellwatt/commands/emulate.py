"""``cellwatt emulate``: a device's side of the wire."""

from __future__ import annotations

import asyncio
import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from cellwatt.commands import EXIT_ERROR
from cellwatt.emulation import ArmSignals, Emulator, Fault, Signals, load_signals
from cellwatt.errors import CellwattError
from cellwatt.registry import driver as find_driver


@click.command()
@click.argument("driver")
@click.option("--listen", "address", default="", help="Where to listen: HOST:PORT (port 0: any free one) or pty.")
@click.option(
    "--recording",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Serve this CSV or Parquet file instead of the built-in arm.",
)
@click.option("--loop", is_flag=True, help="Start the recording again at its end.")
@click.option("--speed", default=1.0, show_default=True, help="Speed of the built-in arm.")
@click.option("--epoch", type=float, help="UTC time in s at which the signals' t is 0 (default: now).")
@click.option("--seed", default=0, show_default=True, help="Seed of noise and faults.")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="JSON",
    help='Fault from the start, e.g. \'{"kind": "loss", "probability": 0.01}\'.',
)
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="The emulator's own options.")
@click.option("--control", is_flag=True, help="Take JSON lines on standard input; end of input ends it.")
def command(
    driver: str,
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
    """Emulate the device that DRIVER speaks to."""
    signals: Signals = ArmSignals(speed=speed, seed=seed) if recording is None else load_signals(recording, loop=loop)
    module, _, name = find_driver(driver).emulator.partition(":")
    emulator_class: type[Emulator] = getattr(import_module(module), name)
    try:
        pairs = dict(_pair(option) for option in options)
        emulator = emulator_class(signals, address, epoch=epoch, seed=seed, options=pairs)
        for text in faults:
            emulator.inject(_fault(text))
    except (ValueError, TypeError) as error:
        raise click.UsageError(str(error)) from error
    try:
        asyncio.run(_serve(emulator, control))
    except KeyboardInterrupt:
        sys.exit(130)


def _pair(option: str) -> tuple[str, str]:
    key, sign, value = option.partition("=")
    if not sign:
        raise ValueError(f"found {option!r} as an option, expected KEY=VALUE")
    return key, value


def _fault(text: str) -> Fault:
    try:
        return Fault(**json.loads(text))
    except (ValueError, TypeError):
        keys = ", ".join(Fault.__dataclass_fields__)
        raise ValueError(f"found {text!r} as a fault, expected a JSON object with kind and others of {keys}") from None


async def _serve(emulator: Emulator, control: bool) -> None:
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    await asyncio.wait((serving, ready), return_when=asyncio.FIRST_COMPLETED)
    if serving.done():
        error = serving.exception()
        if control:
            _say({"error": f"{type(error).__name__}: {error}"})
            sys.exit(EXIT_ERROR)
        raise CellwattError(str(error))
    if not control:
        click.echo(f"{emulator.title} at {ready.result()} (Ctrl-C ends)")
        await serving
        return
    _say({"ready": ready.result()})
    obeying = asyncio.create_task(_obey(emulator))
    await asyncio.wait((serving, obeying), return_when=asyncio.FIRST_COMPLETED)
    for task in (serving, obeying):
        task.cancel()
    for outcome in await asyncio.gather(serving, obeying, return_exceptions=True):
        if isinstance(outcome, Exception):
            raise outcome


async def _obey(emulator: Emulator) -> None:
    reader = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
    while line := await reader.readline():
        try:
            _say(_answer(emulator, json.loads(line)))
        except (ValueError, TypeError) as error:
            _say({"error": str(error)})


def _answer(emulator: Emulator, message: dict[str, Any]) -> dict[str, Any]:
    if "fault" in message:
        emulator.inject(Fault(**message["fault"]))
    elif "disturb" in message:
        emulator.disturb(message["disturb"])
    elif "counts" in message:
        return {"counts": dict(emulator.counts)}
    else:
        raise ValueError("expected one of fault, disturb, counts")
    return {"ok": True}


def _say(message: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(message) + "\n")
    sys.stdout.flush()
