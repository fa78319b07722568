"""One function over many items."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from cellwatt.progress import stage

T = TypeVar("T")
R = TypeVar("R")


def spread(function: Callable[[T], R], items: Sequence[T], what: str) -> list[R]:
    """Results of a function for each item, in the order of the items; ``what`` names the stage of the work.

    The function, items and results must be picklable, and a result must depend on its item alone.
    """
    with stage(what, total=len(items)) as done:
        results = []
        for item in items:
            results.append(function(item))
            done.advance()
        return results
