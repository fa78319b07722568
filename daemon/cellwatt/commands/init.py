"""``cellwatt init``: writes the first settings file of a cell."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import click

from cellwatt.commands import check, completion, doctor
from cellwatt.config.wording import did_you_mean
from cellwatt.errors import ConfigError
from cellwatt.first_cell.ask import ask, ask_sources, complete
from cellwatt.first_cell.plan import LISTEN, RECORD, CellPlan, SourcePlan, parse_source, questions, unreachable
from cellwatt.first_cell.write import write_cell

SITE, CELL = "plant-1", "cell-1"


@click.command(short_help="Write a commented settings file for a cell.")
@click.argument("file", type=click.Path(dir_okay=False, path_type=Path), default=Path("cell.yaml"))
@click.option("--site", help=f"Name of the plant (with --yes: {SITE}).")
@click.option("--cell", help=f"Name of the cell (with --yes: {CELL}).")
@click.option("--robot", help="Robot in the cell: name of a packaged one, or a folder (default: none).")
@click.option(
    "--source",
    "sources",
    multiple=True,
    metavar="NAME=DRIVER:ADDRESS",
    shell_complete=completion.sources,
    help="A device, like arm=ur:192.0.2.10 or meter=power_board:/dev/ttyUSB0; may be repeated.",
)
@click.option(
    "--set",
    "values",
    multiple=True,
    metavar="NAME.KEY=VALUE",
    help="A setting of a source, like 'arm.rate=125 Hz'; may be repeated.",
)
@click.option("--record", help=f"Folder of the record, from FILE's folder on (default: {RECORD}).")
@click.option("--no-record", is_flag=True, help="Record nothing.")
@click.option("--listen", default=LISTEN, show_default=True, help="Zenoh endpoint for watch and subscribers.")
@click.option("--yes", is_flag=True, help="Ask nothing: defaults stand for what is not given.")
@click.option("--no-doctor", is_flag=True, help="Connect to nothing.")
@click.option("--force", is_flag=True, help="Replace FILE where it is there already.")
@click.pass_context
def command(
    ctx: click.Context,
    file: Path,
    site: str | None,
    cell: str | None,
    robot: str | None,
    sources: tuple[str, ...],
    values: tuple[str, ...],
    record: str | None,
    no_record: bool,
    listen: str,
    yes: bool,
    no_doctor: bool,
    force: bool,
) -> None:
    """Write a commented settings file for a cell, by questions or by options.

    Nothing is asked where the options name site, cell and the address of each source, or with --yes. Each device whose
    address you give is opened read-only; nothing else is looked for, and no serial port is opened.
    Exit code 1: FILE is written, and doctor found a device that fails.
    """
    if file.exists() and not force:
        raise click.UsageError(f"{file} is there already: choose another name, or --force to replace it")
    if not file.parent.is_dir():
        raise click.UsageError(f"there is no folder {file.parent}: make it first")
    given = _with_values([parse_source(text) for text in sources], values)
    asking = not yes and at_terminal() and not (site and cell and given and not any(map(unreachable, given)))
    if asking:
        site = site or ask("Site", "The plant; first part of every name that the cell publishes.", SITE)
        cell = cell or ask("Cell", "The cell within the plant; second part of those names.", CELL)
        given = [complete(source) if _incomplete(source) else source for source in given]
        given = given or list(ask_sources(file, given, not no_doctor))
        if record is None and not no_record:
            reason = "Every raw sample is written there first; the oldest files make room from 20 GB on."
            record = ask("Folder of the record (none: record nothing)", reason, RECORD)
            no_record = record == "none"
    elif yes:
        site, cell = site or SITE, cell or CELL
    missing = [option for option, value in (("--site", site), ("--cell", cell), ("--source", given)) if not value]
    missing += [f"the address in --source {s.name}={s.driver}:ADDRESS" for s in given if unreachable(s)]
    if missing or site is None or cell is None:
        raise ConfigError(f"cellwatt init: missing: {', '.join(missing)}{'' if yes else ' (no terminal to ask at)'}")
    place = None if no_record else record or RECORD
    write_cell(file, CellPlan(site, cell, tuple(given), robot, place, listen))
    click.echo(f"\n{file} is written.\n" if asking else f"{file} is written.\n")
    ctx.invoke(check.command, files=(file,))
    try:
        if not no_doctor and (not asking or click.confirm("\nOpen each device now, read-only, and compare?", True)):
            click.echo()
            ctx.invoke(doctor.command, file=file)
    finally:
        _next(file)


def at_terminal() -> bool:
    """True if somebody can be asked."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def _incomplete(source: SourcePlan) -> bool:
    return unreachable(source) or any(key in source.model.asked for key in questions(source))


def _with_values(sources: list[SourcePlan], values: tuple[str, ...]) -> list[SourcePlan]:
    """Sources with the settings of ``--set``. Raises ``UsageError`` where one names no source."""
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
    click.echo("\nNext:")
    for words, what in (
        (f"cellwatt check {file}", "reports mistakes after each change; connects to nothing"),
        (f"cellwatt doctor {file}", "opens each device read-only"),
        (f"cellwatt run {file}", "the daemon; Ctrl-C ends it, SIGHUP applies changes"),
        (f"cellwatt watch {file}", "shows the live cell, in another terminal"),
    ):
        click.echo(f"  {words:<30}  {what}")
    click.echo("As a service: docs/install.md")
