"""``cellwatt record``: runs only sources and recorder, for a given time."""

from __future__ import annotations

import asyncio
import json
import logging
import signal
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.live import Live

from cellwatt.commands.numbers import SECONDS
from cellwatt.config import load
from cellwatt.live.state import LiveCell
from cellwatt.live.view import Look, whole
from cellwatt.log_lines import log_to_stderr
from cellwatt.record import RecordSettings
from cellwatt.record.claim import claimed
from cellwatt.record.settings import default_folder
from cellwatt.runtime.cell import Cell


@click.command(short_help="Record a cell, without stages and outlets.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder (default: record.folder "
    "of FILE; where FILE has no record section ~/.local/state/cellwatt/CELL, for root /var/lib/cellwatt/CELL).",
)
@click.option("--seconds", type=SECONDS, help="How long (default: until Ctrl-C).")
@click.option("--json", "as_json", is_flag=True, help="Print the final figures as one JSON object.")
def command(file: Path, out: Path | None, seconds: float | None, as_json: bool) -> None:
    """Record the sources of FILE, without stages and without publishing anything.

    The first line on stderr names the folder.
    """
    config = load(file)
    settings = config.record or RecordSettings(folder=out or _default(config.cell))
    if out is not None:
        settings = settings.model_copy(update={"folder": out})
    log_to_stderr(logging.WARNING)
    cell = Cell(replace(config, record=settings, stages={}, outlets={}))
    with claimed(settings.folder, config.cell):
        click.echo(f"recording in {settings.folder}", err=True)
        final = asyncio.run(_record(cell, seconds, show=not as_json and Console().is_terminal))
    if as_json:
        click.echo(json.dumps(final))
        return
    for name, source in final["sources"].items():
        lost = sum(source["missed"].values()) + sum(source["dropped"].values())
        click.echo(f"{name}: {source['received']} of {source['expected']} samples, {lost} lost")
    click.echo(f"recorded in {settings.folder}")


def _default(cell: str) -> Path:
    try:
        return default_folder(cell)
    except ValueError as error:
        raise click.UsageError(f"{error}, or --out") from error


async def _record(cell: Cell, seconds: float | None, *, show: bool) -> Mapping[str, Any]:
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, cell.stop)
    if seconds is not None:
        loop.call_later(seconds, cell.stop)
    view = LiveCell()
    with Live(refresh_per_second=4, transient=True, console=Console(quiet=not show)) as live:

        def look(status: Mapping[str, Any]) -> None:
            view.add("health", status)
            live.update(whole(view, Look(live.console.width), "recording "))

        cell.view.on_health = look
        await cell.run()
    return cell.view.status()
