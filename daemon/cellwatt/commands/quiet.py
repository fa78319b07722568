"""``--quiet``: the option of every command that can take more than ten seconds."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

import click

from cellwatt.progress import show_progress

R = TypeVar("R")


def with_progress(command: Callable[..., R]) -> Callable[..., R]:
    """Give a command the option ``--quiet``, and show the work that it does where that is not given."""

    @click.option("--quiet", "-q", is_flag=True, is_eager=True, help="Say nothing of the progress.")
    @wraps(command)
    def run(*args: Any, quiet: bool, **given: Any) -> R:
        with show_progress(quiet):
            return command(*args, **given)

    return run
