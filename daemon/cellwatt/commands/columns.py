"""``--columns``: the option of commands that open tables with names of the user's own."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import click

from cellwatt.tables.names import called

R = TypeVar("R")
HELP = "A name of your own, {} for the joint's number, like 'tau=Moment{}'; repeatable."


def with_columns(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--columns``; within it tables may have the names that it states."""

    @click.option("--columns", multiple=True, metavar="NAME=YOURS", help=HELP)
    @wraps(command)
    def run(*args: Any, columns: tuple[str, ...], **given: Any) -> R:
        pairs = [text.partition("=") for text in columns]
        if wrong := [text for text, (stem, _, own) in zip(columns, pairs, strict=True) if not (stem and own)]:
            raise click.UsageError(f"--columns: found {wrong[0]!r}, expected NAME=YOURS, like 'tau=Moment{{}}'")
        with called({stem: own for stem, _, own in pairs}):
            return command(*args, **given)

    return run
