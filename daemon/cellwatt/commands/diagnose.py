"""``cellwatt diagnose``: writes one bundle for a bug report."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import click

from cellwatt.commands import FILE
from cellwatt.diagnose import bundle_of


@click.command(short_help="Write a bundle for a bug report.")
@click.argument("file", required=False, type=click.Path(path_type=Path))
@click.option("--out", type=FILE, help="Zip file (default: named by the time).")
@click.option("--log", type=click.Path(path_type=Path), help="Log file to use instead of the journal.")
def command(file: Path | None, out: Path | None, log: Path | None) -> None:
    """Write a bundle for a bug report about the cell of FILE: versions, settings, health, log, facts about the PC.

    Secrets and environment variables are left out. If FILE is invalid, the daemon is not running or you may not read
    the log, the bundle states this and contains the rest.
    """
    out = out or Path(f"cellwatt-diagnosis-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.zip")
    bundle = bundle_of(file, log)
    click.echo(bundle.listing(), nl=False)
    bundle.write(out)
    click.echo(f"wrote {out}; read it before you give it to others: it contains names and addresses of your plant")
