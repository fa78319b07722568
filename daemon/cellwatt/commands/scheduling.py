"""``--scheduler``: the option of every command whose work can be given to many workers."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import click

from cellwatt.scheduler import scheduled
from cellwatt.scheduler.place import parse_place

R = TypeVar("R")


def with_scheduler(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--scheduler``, and its calls of ``spread`` to the workers named there."""

    @click.option(
        "--scheduler",
        "place",
        metavar="local|tcp://HOST:PORT",
        callback=_place,
        help=(
            "Do the work on all cores (local; local:2 on two), or on the workers of this dask scheduler. It is "
            "trusted: its answers are pickled objects, so whoever answers in its place runs code here."
        ),
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
