"""Options and arguments that several commands have."""

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
    """A range that holds neither ``nan`` nor an infinity, which ``click.FloatRange`` does not see to."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the number; fails for one that is not finite, or not in the range."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"found {value!r}, expected a finite number", param, ctx)
        return number


FINITE: Final = FiniteRange()
NOT_NEGATIVE: Final = FiniteRange(min=0)
SECONDS: Final = NOT_NEGATIVE
"""A duration in s, or a time since a start."""


class Input(click.Path):
    """A path that is there, or a URL as fsspec knows them (``s3://bucket/key``), given as the path of a copy.

    ``#`` and the part of a log that is meant may follow a path.
    """

    def convert(self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Path of the file or folder. Raises ``CellwattError`` where a URL cannot be fetched."""
        if isinstance(value, str) and is_url(value) and not Path(value).exists():
            if ctx is not None and ctx.resilient_parsing:  # the words of a line that is being typed
                return Path(value)
            try:
                with show_progress(quiet=ctx is not None and bool(ctx.params.get("quiet"))):
                    value = fetch(value)
            except MissingError as error:
                self.fail(str(error), param, ctx)
        place, choice = chosen(Path(value))
        if choice:
            return Path(f"{place}{MARK}{','.join(choice)}")
        return super().convert(value, param, ctx)


INPUT: Final = Input(exists=True, path_type=Path)
"""In place of ``click.Path(exists=True, path_type=Path)`` for what a command reads."""


def with_columns(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--columns``; within it tables may have the names that it states."""

    @click.option(
        "--columns",
        multiple=True,
        metavar="NAME=YOURS",
        help="A name of your own, {} for the joint's number, like 'tau=Moment{}'; repeatable.",
    )
    @wraps(command)
    def run(*args: Any, columns: tuple[str, ...], **given: Any) -> R:
        pairs = [text.partition("=") for text in columns]
        if wrong := [text for text, (stem, _, own) in zip(columns, pairs, strict=True) if not (stem and own)]:
            raise click.UsageError(f"--columns: found {wrong[0]!r}, expected NAME=YOURS, like 'tau=Moment{{}}'")
        with called({stem: own for stem, _, own in pairs}):
            return command(*args, **given)

    return run


def with_progress(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--quiet``, and show the work that it does where that is not given."""

    @click.option("--quiet", "-q", is_flag=True, is_eager=True, help="Say nothing of the progress.")
    @wraps(command)
    def run(*args: Any, quiet: bool, **given: Any) -> R:
        with show_progress(quiet):
            return command(*args, **given)

    return run


def with_scheduler(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--scheduler``, and its calls of ``spread`` to the workers named there."""

    @click.option(
        "--scheduler",
        "place",
        metavar="local[:N]",
        help="Do the work on all cores (local), or on so many (local:2).",
    )
    @wraps(command)
    def run(*args: Any, place: str | None, **given: Any) -> R:
        with scheduled(place):
            return command(*args, **given)

    return run


def with_units(function: Callable[..., R]) -> Callable[..., R]:
    """Give a command ``--units``, which comes as the names of units, to be put in place by ``Units.but``."""

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
