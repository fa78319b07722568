"""Applies one function to many items: one after the other, or in processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import re
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, chdir, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, overload

from cellwatt.child import end_with
from cellwatt.errors import CellwattError, ConfigError
from cellwatt.progress import Stage, stage
from cellwatt.tables.names import called, names_called

T = TypeVar("T")
S = TypeVar("S")
R = TypeVar("R")


class Pool:
    """Worker processes: the first ``run`` starts them, and ``end`` kills them even in mid-work."""

    def __init__(self, count: int | None) -> None:
        self._count = count or len(os.sched_getaffinity(0))
        self._pool: ProcessPoolExecutor | None = None

    def run(self, function: Callable[..., Any], items: Sequence[Any], shared: Any, progress: Stage) -> list[Any]:
        """Results in the order of the items. Raises as ``spread``; ``CellwattError`` if a worker is killed."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            with chdir("/"):  # Python files of the present folder do not stand in for modules of a new process
                self._pool = ProcessPoolExecutor(self._count, context, initializer=_begin, initargs=(os.getpid(),))
        results: list[Any] = []
        with tempfile.NamedTemporaryFile(prefix="cellwatt-shared-") as pickled:
            pickled.write(pickle.dumps(shared))
            pickled.flush()
            call = partial(_call, function, Path.cwd(), names_called(), None if shared is None else pickled.name)
            try:
                with chdir("/"):
                    answers = [self._pool.submit(call, item) for item in items]
                for answer in answers:
                    results.append(answer.result())
                    progress.done = float(len(results))
            except BrokenProcessPool as error:
                self.end()
                item = f"item {len(results) + 1} of {len(items)} ({' '.join(repr(items[len(results)]).split())[:100]})"
                why = "a worker process was killed: is there enough memory?"
                raise CellwattError(f"{progress.name}, at {item} or later: {why}") from error
            except BaseException:
                self.end()  # the running items are not needed any more
                raise
        return results

    def end(self) -> None:
        """Kill the processes; the next ``run`` starts new ones."""
        if self._pool is None:
            return
        for process in list(self._pool._processes.values()):  # kill_workers() of Python 3.14
            process.kill()
        self._pool.shutdown(cancel_futures=True)
        self._pool = None


_WORKERS: ContextVar[Pool | None] = ContextVar("workers", default=None)


def workers() -> Pool | None:
    """The workers of the innermost ``scheduled``; None outside of it, and on a worker."""
    return _WORKERS.get()


@contextmanager
def scheduled(place: str | None) -> Iterator[None]:
    """Within the context, ``spread`` distributes its items to workers.

    ``place`` is ``local`` for one process per core of this machine (``local:2``: two); None changes nothing. Raises
    ``ConfigError`` for other texts.
    """
    if place is None:
        yield
        return
    if (local := re.fullmatch(r"local(?::([1-9]\d{0,2}))?", place)) is None:
        raise ConfigError(f"{place!r} names no scheduler: expected local, or local:2 (that many workers)")
    pool = Pool(None if local[1] is None else int(local[1]))
    token = _WORKERS.set(pool)
    try:
        yield
    finally:
        _WORKERS.reset(token)
        pool.end()


@overload
def spread(function: Callable[[T], R], items: Sequence[T], what: str) -> list[R]: ...
@overload
def spread(function: Callable[[T, S], R], items: Sequence[T], what: str, shared: S) -> list[R]: ...
def spread(function: Callable[..., R], items: Sequence[T], what: str, shared: Any = None) -> list[R]:
    """Results of ``function(item)`` in the order of the items; ``what`` names the stage of the work.

    With ``shared`` the call is ``function(item, shared)``; each worker gets ``shared`` once. Function, items,
    ``shared`` and results must be picklable, and a result must depend on its item and ``shared`` alone, which no call
    may change. Raises the exception of the first item for which the function fails.
    """
    found = workers()
    with stage(what, total=len(items)) as progress:
        if found is not None and len(items) > 1:  # a single item may spread its own items to the workers
            return found.run(function, items, shared, progress)
        results = []
        for i, item in enumerate(items):
            with _one_thread():
                results.append(function(item) if shared is None else function(item, shared))
            progress.done = i + 1.0
        return results


# on a worker -----------------------------------------------------------------------------------------------------

_held: tuple[str, Any] | None = None
"""File and value of ``shared`` of the present call of ``spread``."""


def _begin(parent: int) -> None:
    """Ignore Ctrl-C, which the command handles, and end with the command even if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent, signal.SIGKILL)


def _call(
    function: Callable[..., Any], folder: Path, names: Sequence[tuple[str, str]], shared: str | None, item: Any
) -> Any:
    """Call the function in ``folder`` and with the user's ``names`` of columns, as the command runs, so that relative
    paths and tables have the same meaning."""
    global _held  # one value per worker for all items
    with suppress(OSError):  # without the folder, the function reports which relative path is missing
        os.chdir(folder)
    if shared is not None and (_held is None or _held[0] != shared):
        _held = shared, pickle.loads(Path(shared).read_bytes())
    with _one_thread(), called(names):
        try:
            return function(item) if shared is None or _held is None else function(item, _held[1])
        except Exception as error:
            if _can_be_sent(error):
                raise
            raise CellwattError(f"{type(error).__name__}: {' '.join(str(error).split())}") from None


def _can_be_sent(error: Exception) -> bool:
    try:
        return isinstance(pickle.loads(pickle.dumps(error)), type(error))
    except Exception:  # a third-party exception class may fail in any way
        return False


_known: tuple[int, Any] = (-1, None)
"""Number of modules loaded at the last search for libraries of linear algebra, and the controller of their threads."""


def _one_thread() -> AbstractContextManager[object]:
    """Run linear algebra in one thread, if threadpoolctl is installed: results do not depend on where an item runs."""
    global _known  # the search for the libraries takes 5 ms, long beside a small item
    if len(sys.modules) != _known[0]:
        try:
            from threadpoolctl import ThreadpoolController
        except ModuleNotFoundError:
            return nullcontext()
        found = ThreadpoolController()
        _known = (len(sys.modules), found)
    limited: AbstractContextManager[object] = _known[1].limit(limits=1)
    return limited
