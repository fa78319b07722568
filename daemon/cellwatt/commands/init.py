"""``cellwatt init``: writes the first settings file of a cell."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

import click

from cellwatt.commands import FILE, check, doctor
from cellwatt.config.wording import did_you_mean
from cellwatt.first_cell import RECORD, SourcePlan, parse_source, write_cell


@click.command(short_help="Write a commented settings file for a cell.")
@click.argument("file", type=FILE, default=Path("cell.yaml"))
@click.option("--site", default="plant-1", show_default=True, help="Name of the plant.")
@click.option("--cell", default="cell-1", show_default=True, help="Name of the cell.")
@click.option("--robot", help="Robot in the cell: name of a packaged robot, or a folder (default: none).")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="NAME=DRIVER:ADDRESS",
    help="A device, like arm=ur:192.0.2.10 or meter=power_board:/dev/ttyUSB0; may be repeated.",
)
@click.option(
    "--set",
    "values",
    multiple=True,
    metavar="NAME.KEY=VALUE",
    help="A setting of a source, like 'arm.rate=125 Hz'; may be repeated.",
)
@click.option("--record", default=RECORD, show_default=True, help="Folder for recordings, relative to FILE.")
@click.option("--no-doctor", is_flag=True, help="Do not connect to the devices.")
@click.option("--force", is_flag=True, help="Replace FILE if it exists.")
@click.pass_context
def command(
    ctx: click.Context,
    file: Path,
    site: str,
    cell: str,
    robot: str | None,
    sources: tuple[str, ...],
    values: tuple[str, ...],
    record: str,
    no_doctor: bool,
    force: bool,
) -> None:
    """Write a commented settings file for a cell.

    `cellwatt drivers` lists the drivers, `cellwatt drivers NAME` the settings of one. Each device is opened read-only,
    unless --no-doctor is given. Exit code 1: FILE is written, but doctor found a device that fails.
    """
    if file.exists() and not force:
        raise click.UsageError(f"{file} already exists: choose another name, or --force to replace it")
    if not file.parent.is_dir():
        raise click.UsageError(f"the folder {file.parent} does not exist: make it first")
    given = _with_values([parse_source(text) for text in sources], values)
    if not given:
        raise click.UsageError("name each device: --source NAME=DRIVER:ADDRESS, like --source arm=ur:192.0.2.10")
    write_cell(file, site, cell, given, robot, record)
    click.echo(f"{file} is written.\n")
    ctx.invoke(check.command, files=(file,))
    try:
        if not no_doctor:
            click.echo()
            ctx.invoke(doctor.command, file=file)
    finally:
        _next(file)


def _with_values(sources: list[SourcePlan], values: tuple[str, ...]) -> list[SourcePlan]:
    """Return the sources with the settings of ``--set``. Raises ``UsageError`` if a setting names no source."""
    named = {source.name: source for source in sources}
    if len(named) < len(sources):
        raise click.UsageError("--source: two sources have the same name")
    for text in values:
        path, equals, value = text.partition("=")
        name, dot, key = path.partition(".")
        if not equals or not dot or "\n" in value:
            raise click.UsageError(f"--set: found {text!r}, expected NAME.KEY=VALUE, like 'arm.rate=125 Hz'")
        if name not in named:
            raise click.UsageError(f"--set: there is no source {name!r}{did_you_mean(name, named)}")
        named[name] = replace(named[name], settings={**named[name].settings, key: value})
    return list(named.values())


def _next(file: Path) -> None:
    shown = shlex.quote(str(file))
    click.echo("\nNext:")
    for words, what in (
        (f"cellwatt check {shown}", "reports mistakes after each change; connects to nothing"),
        (f"cellwatt doctor {shown}", "opens each device read-only"),
        (f"cellwatt run {shown}", "the daemon; Ctrl-C ends it, SIGHUP applies changes"),
        (f"cellwatt watch {shown}", "shows the live cell, in another terminal"),
    ):
        click.echo(f"  {words:<30}  {what}")
    click.echo("As a service: docs/install.md")
