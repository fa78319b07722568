"""The option ``--units`` of commands that show or export measured values."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import click

from cellwatt.units import Units

F = TypeVar("F", bound=Callable[..., object])


def with_units(function: F) -> F:
    """Give a command ``--units``, which comes as the names of units, to be put in place by ``Units.but``."""
    return click.option(
        "--units",
        metavar="UNIT,...",
        multiple=True,
        callback=_names,
        help="Units to show values in, e.g. kWh,deg,degF; SI for all. docs/settings.md lists them.",
    )(function)


def _names(context: click.Context, parameter: click.Parameter, given: tuple[str, ...]) -> tuple[str, ...]:
    names = tuple(name.strip() for text in given for name in text.split(","))
    try:
        Units().but(names)
    except ValueError as error:
        raise click.BadParameter(str(error)) from error
    return names
