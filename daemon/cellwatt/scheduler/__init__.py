"""One function over many items: one after the other, or in processes of this machine."""

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
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, overload

from cellwatt.child import end_with
from cellwatt.errors import CellwattError, ConfigError
from cellwatt.progress import Stage, stage

T = TypeVar("T")
S = TypeVar("S")
R = TypeVar("R")


class Pool:
    """Processes that the first ``run`` starts, and that end with the context, whatever they are at."""

    def __init__(self, count: int | None) -> None:
        self._count = count or len(os.sched_getaffinity(0))
        self._pool: ProcessPoolExecutor | None = None

    def run(self, function: Callable[..., Any], items: Sequence[Any], shared: Any, told: Stage) -> list[Any]:
        """Results in the order of the items. Raises as ``spread``; ``CellwattError`` where a worker is killed."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._count, context, initializer=_begin, initargs=(os.getpid(),))
        results: list[Any] = []
        with tempfile.NamedTemporaryFile(prefix="cellwatt-shared-") as kept:
            kept.write(pickle.dumps(shared))
            kept.flush()
            call = partial(_call, function, Path.cwd(), None if shared is None else kept.name)
            try:
                for answer in [self._pool.submit(call, item) for item in items]:
                    results.append(answer.result())
                    told.done = float(len(results))
            except BrokenProcessPool as error:
                self.end()
                item = f"item {len(results) + 1} of {len(items)} ({' '.join(repr(items[len(results)]).split())[:100]})"
                why = "a worker process was killed: is there enough memory?"
                raise CellwattError(f"{told.name}, at {item} or later: {why}") from error
            except BaseException:
                self.end()  # what has begun is needed by nobody
                raise
        return results

    def end(self) -> None:
        """Kill the processes; the next ``run`` starts others."""
        if self._pool is None:
            return
        for process in list(self._pool._processes.values()):  # kill_workers() of Python 3.14
            process.kill()
        self._pool.shutdown(cancel_futures=True)
        self._pool = None


_WORKERS: ContextVar[Pool | None] = ContextVar("workers", default=None)


def workers() -> Pool | None:
    """The workers of the innermost ``scheduled``; None outside, and for an item that is on a worker."""
    return _WORKERS.get()


def parse_place(text: str) -> int | None:
    """Number of workers that ``local`` or ``local:2`` asks for, None for one a core. Raises ``ConfigError``."""
    if (local := re.fullmatch(r"local(?::([1-9]\d{0,2}))?", text)) is None:
        raise ConfigError(f"{text!r} names no scheduler: expected local, or local:2 (that many workers)")
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
    pool = Pool(parse_place(place))
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
            with _one_thread():
                results.append(function(item) if shared is None else function(item, shared))
            told.done = i + 1.0
        return results


# on a worker -----------------------------------------------------------------------------------------------------

_held: tuple[str, Any] | None = None
"""What the items of the present work share: its file, and the value."""


def _begin(parent: int) -> None:
    """Leave Ctrl-C to the command, and end with it even where it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent, signal.SIGKILL)


def _call(function: Callable[..., Any], folder: Path, shared: str | None, item: Any) -> Any:
    """Call the function in ``folder``, where the command runs, so that a relative path means the same."""
    global _held  # one value a worker, however many items
    with suppress(OSError):  # not there: a relative path is not either, which the function tells
        os.chdir(folder)
    if shared is not None and (_held is None or _held[0] != shared):
        _held = shared, pickle.loads(Path(shared).read_bytes())
    try:
        with _one_thread():
            return function(item) if shared is None or _held is None else function(item, _held[1])
    except Exception as error:
        if _can_be_sent(error):
            raise
        raise CellwattError(f"{type(error).__name__}: {' '.join(str(error).split())}") from None


def _can_be_sent(error: Exception) -> bool:
    try:
        return isinstance(pickle.loads(pickle.dumps(error)), type(error))
    except Exception:  # an exception class of others may fail in any way
        return False


_known: tuple[int, Any] = (-1, None)
"""Number of modules that were loaded when the libraries were looked for, and what limits those."""


def _one_thread() -> AbstractContextManager[object]:
    """Linear algebra in one thread, where threadpoolctl is installed: the same numbers wherever an item is done."""
    global _known  # looking for the libraries takes 5 ms, which is long beside a small item
    if len(sys.modules) != _known[0]:
        try:
            from threadpoolctl import ThreadpoolController
        except ModuleNotFoundError:
            return nullcontext()
        found = ThreadpoolController()
        _known = (len(sys.modules), found)
    limited: AbstractContextManager[object] = _known[1].limit(limits=1)
    return limited
