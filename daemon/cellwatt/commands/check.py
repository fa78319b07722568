"""``cellwatt check``: validates settings files."""

from __future__ import annotations

import json
import sys
from collections.abc import Sized
from pathlib import Path

import click

from cellwatt.commands import EXIT_USAGE
from cellwatt.commands.drivers import rate_of
from cellwatt.commands.ranges import together
from cellwatt.config import CellConfig, json_schema, load
from cellwatt.config.places import ordered, position
from cellwatt.errors import ConfigError, Problem
from cellwatt.progress.terminal import show_table
from cellwatt.record.folder import Obstacles, obstacles
from cellwatt.runtime.assemble import Prepared, prepare


@click.command(short_help="Check settings files; connects to nothing.")
@click.argument("files", metavar="FILE...", nargs=-1, type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print the problems as a JSON list.")
@click.option("--schema", is_flag=True, help="Print the JSON Schema of a settings file, for editors, and exit.")
def command(files: tuple[Path, ...], as_json: bool, schema: bool) -> None:
    """Check settings files without connecting to anything.

    Prints one line per error, in file order. Exit code 2 if there is an error; a record folder that cannot be created
    is an error. Settings that are valid but dangerous, a record folder that cannot be written, and a disk with less
    free space than `keep` requires are warnings on stderr.
    """
    if schema:
        click.echo(json.dumps(json_schema(), indent=2, ensure_ascii=False))
        return
    if not files:
        raise click.UsageError("expected a settings file: cellwatt check FILE...")
    problems: list[Problem] = []
    for file in files:
        try:
            config = load(file)
            prepared = prepare(config)
        except ConfigError as error:
            problems += error.problems
        else:
            if refused := warn(file, config):
                problems.append(refused)
            elif not as_json:
                _describe(config, prepared)
    problems = ordered(problems)
    if as_json:
        click.echo(json.dumps([_plain(p) for p in problems], indent=2, ensure_ascii=False))
    for problem in () if as_json else problems:
        click.echo(str(problem))
    if problems:
        sys.exit(EXIT_USAGE)


def warn(file: Path, config: CellConfig) -> Problem | None:
    """Print warnings about valid but dangerous settings on stderr; return the problem that prevents recording."""
    found = obstacles(config.record) if config.record is not None else Obstacles()
    for warning in (*config.warnings, *(f"record: {text}" for text in found.warnings)):
        click.echo(f"{file}: warning: {warning}", err=True)
    return Problem(config.record_place, "record.folder", found.refusal) if found.refusal else None


def _plain(problem: Problem) -> dict[str, str | int | None]:
    return {**position(problem)._asdict(), "path": problem.path, "message": problem.message}


def _describe(config: CellConfig, prepared: Prepared) -> None:
    click.echo(
        f"{config.path}: configuration is valid. Cell {config.cell} at {config.site}: "
        f"{_count(config.sources, 'source')}, {_count(prepared.layout.channels, 'channel')} "
        f"in frames at {config.frames.rate:g} Hz with a latency of {1e3 * config.frames.latency:g} ms"
    )
    show_table(
        ("source", "driver", "stream", "rate", "clock", "channels"),
        [
            (
                name,
                config.sources[name].driver,
                stream.name,
                rate_of(stream),
                stream.clock,
                ", ".join(together(stream.names)),
            )
            for name, streams in prepared.streams.items()
            for stream in streams
        ],
    )
    if prepared.stages:
        click.echo()
        rows = [(n, config.stages[n].kind, ", ".join(s.needs)) for n, s in prepared.stages.items()]
        show_table(("stage", "kind", "needs"), rows)
    recorded = "nothing" if config.record is None else str(config.record.folder)
    click.echo(f"\nrecord: {recorded}; outlets: {', '.join(config.outlets) or 'none'}")


def _count(things: Sized, what: str) -> str:
    return f"{len(things)} {what}{'' if len(things) == 1 else 's'}"
