"""A progress bar for long work; nothing where nobody looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress

Advance = Callable[[float, str], None]
"""Tells how much of the work was done since the last call, and what comes next."""


@contextmanager
def progress_bar(total: float, quiet: bool = False) -> Iterator[Advance]:
    """A bar on stderr that ends at ``total``; none where stderr is no terminal, or ``quiet``."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=quiet or not console.is_terminal) as progress:
        task = progress.add_task("", total=total)
        yield lambda done, text: progress.update(task, advance=done, description=text)
