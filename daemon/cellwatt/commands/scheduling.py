"""``--scheduler``: the option of every command whose work can be given to many workers."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import click

from cellwatt.scheduler import scheduled
from cellwatt.scheduler.spread import parse_place

R = TypeVar("R")


def with_scheduler(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--scheduler``, and its calls of ``spread`` to the workers named there."""

    @click.option(
        "--scheduler",
        "place",
        metavar="local[:N]",
        callback=_place,
        help="Do the work on all cores (local), or on so many (local:2).",
    )
    @wraps(command)
    def run(*args: Any, place: str | None, **given: Any) -> R:
        with scheduled(place):
            return command(*args, **given)

    return run


def _place(context: click.Context, parameter: click.Parameter, given: str | None) -> str | None:
    if given is not None:
        try:
            parse_place(given)
        except ValueError as error:
            raise click.BadParameter(str(error)) from None
    return given
