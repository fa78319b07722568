"""The option ``--units`` of commands that show or export measured values."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import click
from pydantic import ValidationError

from cellwatt.errors import RecordingError
from cellwatt.units import Units
from cellwatt.yaml_file import NotYamlError, parse_yaml

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


def recorded_units(settings: str, names: Iterable[str]) -> Units:
    """Units of a recording's ``settings``, the text in its header, with those of the command line in their place.

    Raises ``RecordingError`` where they cannot be read.
    """
    try:
        written = parse_yaml(settings)
        chosen = written.get("units") if isinstance(written, dict) else None
        return Units.model_validate(chosen or {}).but(names)
    except NotYamlError as error:
        raise RecordingError(f"the settings in the recording cannot be read: {str(error).splitlines()[0]}") from error
    except ValidationError:
        raise RecordingError("the units in the recording's settings cannot be read: expected names of units") from None
