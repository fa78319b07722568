"""``cellwatt health``: queries the running daemon once, for health checks and scripts."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from cellwatt.commands import EXIT_FAILED
from cellwatt.config import load
from cellwatt.outlets.zenoh.reach import ask_cell


@click.command(short_help="Query the state of a running cell.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the whole health message as one JSON object.")
def command(file: Path, as_json: bool) -> None:
    """Query the running daemon of FILE for the state of its cell.

    Exit code 0: green or amber; 1: red (no source delivers, or the recorder cannot write); 3: the daemon does not
    answer.
    """
    message = ask_cell(load(file), "status")
    status = message["status"]
    if as_json:
        click.echo(json.dumps(message))
    else:
        states = [source["state"] for source in status["sources"].values()]
        click.echo(f"{status['state']}: {states.count('ok')} of {len(states)} sources are up")
    if status["state"] == "red":
        sys.exit(EXIT_FAILED)
