"""``cellwatt record``: runs only the sources and the recorder, for a given time."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from cellwatt.commands import FOLDER
from cellwatt.commands.options import SECONDS
from cellwatt.config import CellConfig, load
from cellwatt.errors import RecordingError
from cellwatt.progress.log_lines import log_to_stderr
from cellwatt.record import Recording, RecordSettings
from cellwatt.record.folder import claimed, listing
from cellwatt.record.settings import default_folder
from cellwatt.runtime.processes.supervisor import Supervisor

LAST = 10 * 10**9
"""Time, ns, before the end of a recording that is searched for the last health message; there is one per second."""


@click.command(short_help="Record a cell, without stages and outlets.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=FOLDER,
    help="Folder (default: record.folder "
    "of FILE; if FILE has no record section ~/.local/state/cellwatt/CELL, for root /var/lib/cellwatt/CELL).",
)
@click.option("--seconds", type=SECONDS, help="Run time, s (default: until Ctrl-C).")
@click.option("--json", "as_json", is_flag=True, help="Print the final figures as one JSON object.")
def command(file: Path, out: Path | None, seconds: float | None, as_json: bool) -> None:
    """Record the sources of FILE, without stages and without publishing anything.

    The first line on stderr names the folder.
    """
    config, settings = _recorded(file, out)
    log_to_stderr(logging.WARNING)
    daemon = Supervisor(config, lambda: _recorded(file, out)[0], math.inf if seconds is None else seconds)
    with claimed(settings.folder, config.cell):
        click.echo(f"recording in {settings.folder}", err=True)
        daemon.run()
    final = _figures(settings.folder, config.cell, daemon.session)
    if as_json:
        click.echo(json.dumps(final))
        return
    for name, source in final["sources"].items():
        lost = sum(source["missed"].values()) + sum(source["dropped"].values())
        click.echo(f"{name}: {source['received']} of {source['expected']} samples, {lost} lost")
    click.echo(f"recorded in {settings.folder}")


def _recorded(file: Path, out: Path | None) -> tuple[CellConfig, RecordSettings]:
    """Settings of the cell without stages and outlets, and its record settings."""
    config = load(file)
    settings = config.record or RecordSettings(folder=out or default_folder(config.cell))
    if out is not None:
        settings = settings.model_copy(update={"folder": out})
    return replace(config, record=settings, stages={}, outlets={}), settings


def _figures(folder: Path, cell: str, session: int) -> Mapping[str, Any]:
    """Last health status in the recording of a session. Raises ``RecordingError`` if there is none."""
    files = [recording.path for recording in listing(folder, cell) if recording.name.session == session]
    last = Recording.open(files[-1]) if files else None
    healths = [] if last is None else list(last.between(last.end - LAST, last.end).health())
    if not healths:
        raise RecordingError(f"{folder}: nothing could be recorded")
    return healths[-1].status
