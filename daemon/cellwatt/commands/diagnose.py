"""``cellwatt diagnose``: writes one bundle for a bug report."""

from __future__ import annotations

import tempfile
from datetime import UTC, datetime
from pathlib import Path

import click
from pydantic import TypeAdapter, ValidationError

from cellwatt.diagnose import bundle_of
from cellwatt.quantity import Seconds


@click.command(short_help="Write a bundle for a bug report.")
@click.argument("file", required=False, type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="The zip (default: named by the time).")
@click.option("--record", metavar="TIME", help="Also the last minutes of the record, e.g. --record '5 min'.")
@click.option("--log", type=click.Path(path_type=Path), help="File with the log, instead of the journal.")
def command(file: Path | None, out: Path | None, record: str | None, log: Path | None) -> None:
    """Write a bundle for a bug report about the cell of FILE: versions, settings, health, log, facts about the PC.

    Secrets and environment variables stay out. A file that is wrong, a daemon that does not run and a log that you may
    not read are told, and the rest is written.
    """
    seconds = _seconds(record)
    out = out or Path(f"cellwatt-diagnosis-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.zip")
    with tempfile.TemporaryDirectory() as folder:
        bundle = bundle_of(file, log, seconds, Path(folder))
        click.echo(bundle.listing(), nl=False)
        bundle.write(out)
    click.echo(f"wrote {out}; read it before you give it to others, it names your plant and its addresses")


def _seconds(text: str | None) -> float:
    if text is None:
        return 0.0
    try:
        seconds: float = TypeAdapter(Seconds).validate_python(text)
    except ValidationError as error:
        raise click.UsageError(f"--record {text}: {error.errors()[0]['msg'].removeprefix('Value error, ')}") from None
    return seconds
