"""One function over many items, here or on the workers of the scheduler that the command was given."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar, overload

from cellwatt.progress import stage
from cellwatt.scheduler.ambient import cluster
from cellwatt.scheduler.threads import one_thread

T = TypeVar("T")
S = TypeVar("S")
R = TypeVar("R")


@overload
def spread(function: Callable[[T], R], items: Sequence[T], what: str) -> list[R]: ...
@overload
def spread(function: Callable[[T, S], R], items: Sequence[T], what: str, shared: S) -> list[R]: ...
def spread(function: Callable[..., R], items: Sequence[T], what: str, shared: Any = None) -> list[R]:
    """Results of ``function(item)`` in the order of the items; ``what`` names the stage of the work.

    Where ``shared`` is given it is ``function(item, shared)``: each worker gets that once. All of them must be
    picklable, and a result must depend on its item and ``shared`` alone, which no call may change. Raises what the
    function raises for the first of the items that it fails for.
    """
    workers = cluster()
    with stage(what, total=len(items)) as told:
        if workers is not None and len(items) > 1:  # what a single one spreads in turn is for the workers
            return workers.run(function, items, shared, told)
        results = []
        for i, item in enumerate(items):
            with one_thread():
                results.append(function(item) if shared is None else function(item, shared))
            told.done = i + 1.0
        return results
