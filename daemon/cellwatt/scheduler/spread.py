"""One function over many items, here or by the workers that the command was given."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Protocol, TypeVar, overload

from cellwatt.errors import ConfigError
from cellwatt.progress import Stage, stage
from cellwatt.scheduler.place import parse_place
from cellwatt.scheduler.pool import Pool
from cellwatt.scheduler.threads import one_thread

T = TypeVar("T")
S = TypeVar("S")
R = TypeVar("R")


class Workers(Protocol):
    """Processes that do the items of ``spread``."""

    def run(self, function: Callable[..., Any], items: Sequence[Any], shared: Any, told: Stage) -> list[Any]:
        """Results in the order of the items. Raises the function's error for the first item that it fails for."""


_WORKERS: ContextVar[Workers | None] = ContextVar("workers", default=None)


def workers() -> Workers | None:
    """The workers of the innermost ``scheduled``; None outside, and for an item that is on a worker."""
    return _WORKERS.get()


@contextmanager
def scheduled(place: str | None) -> Iterator[None]:
    """Let ``spread`` give its items to workers inside.

    ``place`` is ``local`` for a process a core of this machine (``local:2``: two), or a dask scheduler
    (``tcp://host:8786``, ``tls://host:8786``); None changes nothing. Raises ``ConfigError`` where it names neither or
    dask is missing, ``CellwattError`` where nobody answers.
    """
    if place is None:
        yield
        return
    try:
        found = parse_place(place)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if found.address is None:
        opened: Any = Pool(found.workers)
    else:
        try:
            from cellwatt.scheduler.hosts import Hosts
        except ModuleNotFoundError as error:
            if error.name is None or error.name.startswith("cellwatt"):
                raise
            raise ConfigError(f"a scheduler needs the package {error.name}: pip install 'cellwatt[scale]'") from error
        opened = Hosts(found.address)
    with opened:
        token = _WORKERS.set(opened)
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
