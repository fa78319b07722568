"""``cellwatt run``: the daemon."""

from __future__ import annotations

import logging
from pathlib import Path

import click

from cellwatt.config import load
from cellwatt.progress.log_lines import log_to_stderr
from cellwatt.runtime.processes.supervisor import Supervisor


@click.command(short_help="Run the daemon of a cell.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--verbose", "-v", is_flag=True, help="Log debug messages.")
def command(file: Path, verbose: bool) -> None:
    """Run the daemon of the cell in FILE until SIGTERM or SIGINT; SIGHUP applies changes of FILE."""
    log_to_stderr(logging.DEBUG if verbose else logging.INFO)
    Supervisor(load(file)).run()
