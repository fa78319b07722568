"""Options and arguments shared by several commands."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from cellwatt.fetch import MissingError, fetch, is_url
from cellwatt.logs.choice import MARK, chosen
from cellwatt.progress import show_progress
from cellwatt.scheduler import scheduled
from cellwatt.tables.names import called
from cellwatt.units import Units

R = TypeVar("R")


class FiniteRange(click.FloatRange):
    """A range that refuses ``nan`` and infinities, which ``click.FloatRange`` accepts."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; fails if it is not finite or out of range."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"found {value!r}, expected a finite number", param, ctx)
        return number

    def _describe_range(self) -> str:
        return "" if self.min is None and self.max is None else super()._describe_range()


FINITE: Final = FiniteRange()
POSITIVE: Final = FiniteRange(min=0, min_open=True)
SECONDS: Final = FiniteRange(min=0)
"""A duration in s, or a time since a start."""


class Input(click.Path):
    """An existing path, or an fsspec URL (``s3://bucket/key``), which is converted to the path of a downloaded copy.

    A path may be followed by ``#`` and the name of a section of a log.
    """

    def convert(self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path of the file or folder. Raises ``CellwattError`` if a URL cannot be fetched."""
        if isinstance(value, str) and is_url(value) and not Path(value).exists():
            if ctx is not None and ctx.resilient_parsing:  # shell completion: the line is still being typed
                return Path(value)
            try:
                with show_progress(quiet=ctx is not None and bool(ctx.params.get("quiet"))):
                    value = fetch(value)
            except MissingError as error:
                self.fail(str(error), param, ctx)
        path, choice = chosen(Path(value))
        if choice:
            return Path(f"{path}{MARK}{','.join(choice)}")
        return super().convert(value, param, ctx)


INPUT: Final = Input(exists=True, path_type=Path)
"""Type of each argument that a command reads as input; replaces ``click.Path(exists=True, path_type=Path)``."""


def with_columns(command: Callable[..., R]) -> Callable[..., R]:
    """Add the option ``--columns`` to a command; while the command runs, tables may have the column names given."""

    @click.option(
        "--columns",
        multiple=True,
        metavar="NAME=YOURS",
        help="Your name of a column, {} for the joint number, like 'tau=Moment{}'; may be repeated.",
    )
    @wraps(command)
    def run(*args: Any, columns: tuple[str, ...], **given: Any) -> R:
        pairs = [text.partition("=") for text in columns]
        if wrong := [text for text, (stem, _, own) in zip(columns, pairs, strict=True) if not (stem and own)]:
            raise click.UsageError(f"--columns: found {wrong[0]!r}, expected NAME=YOURS, like 'tau=Moment{{}}'")
        with called([(stem, own) for stem, _, own in pairs]) as idle:
            try:
                return command(*args, **given)
            finally:
                for own in () if given.get("workers") else idle():  # workers read files, too
                    click.echo(f"--columns: no column is called {own!r}", err=True)

    return run


def with_progress(command: Callable[..., R]) -> Callable[..., R]:
    """Add the option ``--quiet`` to a command; without it, the command shows its progress."""

    @click.option("--quiet", "-q", is_flag=True, is_eager=True, help="Show no progress.")
    @wraps(command)
    def run(*args: Any, quiet: bool, **given: Any) -> R:
        with show_progress(quiet):
            return command(*args, **given)

    return run


def with_scheduler(command: Callable[..., R]) -> Callable[..., R]:
    """Add the option ``--scheduler`` to a command; its calls of ``spread`` run on the workers given there."""

    @click.option(
        "--scheduler",
        "workers",
        metavar="local[:N]",
        help="Run on all cores (local), or on N cores (local:N).",
    )
    @wraps(command)
    def run(*args: Any, workers: str | None, **given: Any) -> R:
        with scheduled(workers):
            return command(*args, **given)

    return run


def with_units(function: Callable[..., R]) -> Callable[..., R]:
    """Add the option ``--units`` to a command, which receives the names of the units, for ``Units.but``."""

    def names(context: click.Context, parameter: click.Parameter, given: tuple[str, ...]) -> tuple[str, ...]:
        found = tuple(name.strip() for text in given for name in text.split(","))
        try:
            Units().but(found)
        except ValueError as error:
            raise click.BadParameter(str(error)) from error
        return found

    return click.option(
        "--units",
        metavar="UNIT,...",
        multiple=True,
        callback=names,
        help="Units to show values in, e.g. kWh,deg,degF; SI for all. docs/settings.md lists them.",
    )(function)
