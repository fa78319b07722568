"""One function over many items, here or in processes of this machine."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final, TypeVar, overload

from cellwatt.errors import ConfigError
from cellwatt.progress import stage
from cellwatt.scheduler.pool import Pool
from cellwatt.scheduler.threads import one_thread

T = TypeVar("T")
S = TypeVar("S")
R = TypeVar("R")


EXPECTED: Final = "expected local, or local:2 (that many workers)"

_WORKERS: ContextVar[Pool | None] = ContextVar("workers", default=None)


def workers() -> Pool | None:
    """The workers of the innermost ``scheduled``; None outside, and for an item that is on a worker."""
    return _WORKERS.get()


def parse_place(text: str) -> int | None:
    """Number of workers that ``local`` or ``local:2`` asks for, None for one a core. Raises ``ValueError``."""
    if (local := re.fullmatch(r"local(?::([1-9]\d{0,2}))?", text)) is None:
        raise ValueError(f"{text!r} names no scheduler: {EXPECTED}")
    return None if local[1] is None else int(local[1])


@contextmanager
def scheduled(place: str | None) -> Iterator[None]:
    """Let ``spread`` give its items to workers inside.

    ``place`` is ``local`` for a process a core of this machine (``local:2``: two); None changes nothing. Raises
    ``ConfigError`` where it is neither.
    """
    if place is None:
        yield
        return
    try:
        count = parse_place(place)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    with Pool(count) as pool:
        token = _WORKERS.set(pool)
        try:
            yield
        finally:
            _WORKERS.reset(token)


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
    found = workers()
    with stage(what, total=len(items)) as told:
        if found is not None and len(items) > 1:  # what a single one spreads in turn is for the workers
            return found.run(function, items, shared, told)
        results = []
        for i, item in enumerate(items):
            with one_thread():
                results.append(function(item) if shared is None else function(item, shared))
            told.done = i + 1.0
        return results
