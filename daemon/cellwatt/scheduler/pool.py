"""Worker processes of this machine: one a core, or as many as were asked for."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import shutil
import signal
import tempfile
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from cellwatt.child import end_with
from cellwatt.errors import CellwattError
from cellwatt.progress import Stage
from cellwatt.scheduler.parcel import call, parcels, result, shortened

Answer = Future[tuple[bool, bytes]]


class Pool:
    """Processes that the first ``run`` starts, and that end with the context, whatever they are at."""

    def __init__(self, count: int | None) -> None:
        self._count = count or len(os.sched_getaffinity(0))
        self._pool: ProcessPoolExecutor | None = None
        self._folder: Path | None = None

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def run(self, function: Callable[..., Any], items: Sequence[Any], shared: Any, told: Stage) -> list[Any]:
        """Results in the order of the items. Raises as ``spread``; ``CellwattError`` for an item that kills a worker.

        When a worker dies, its items are done again, one at a time, so that the one that kills it is known.
        """
        calls, kept = parcels(function, items), self._shared(shared)
        answers: list[Answer | None] = [self._submit(parcel, kept) for parcel in calls]
        results: list[Any] = []
        alone = 0  # items before this one may have been with a worker when the last one died
        try:
            for i, parcel in enumerate(calls):
                if answers[i] is None and i >= alone:
                    rest = zip(answers[i:], calls[i:], strict=True)
                    answers[i:] = [there or self._submit(one, kept) for there, one in rest]
                if (answer := answers[i]) is not None and _is_lost(answer):
                    self._end()
                    answers = [None if there is None or _is_lost(there) else there for there in answers]
                    alone, answer = i + self._count, None
                if answer is None:
                    answer = self._submit(parcel, kept)
                    if _is_lost(answer):
                        name = f"{told.name}: item {i + 1} of {len(items)} ({shortened(items[i])})"
                        raise CellwattError(f"{name} kills the process that takes it: is there enough memory?")
                results.append(result(answer.result()))
                told.done = i + 1.0
        except BaseException:
            self._end()  # what has begun is needed by nobody
            raise
        finally:
            if kept is not None:
                kept.unlink()
        return results

    def _submit(self, parcel: bytes, shared: Path | None) -> Answer:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._count, context, initializer=_begin, initargs=(os.getpid(),))
        try:
            return self._pool.submit(call, parcel, str(Path.cwd()), shared)
        except BrokenProcessPool as error:  # a worker has died since the item before
            lost = Answer()
            lost.set_exception(error)
            return lost

    def _shared(self, value: Any) -> Path | None:
        if value is None:
            return None
        self._folder = self._folder or Path(tempfile.mkdtemp(prefix="cellwatt-workers-"))
        path = self._folder / uuid.uuid4().hex
        path.write_bytes(pickle.dumps(value))
        return path

    def _end(self) -> None:
        if self._pool is None:
            return
        for process in list(self._pool._processes.values()):  # kill_workers() of Python 3.14
            process.kill()
        self._pool.shutdown(cancel_futures=True)
        self._pool = None


def _begin(parent: int) -> None:
    """Leave Ctrl-C to the command, and end with it even where it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent, signal.SIGKILL)


def _is_lost(answer: Answer) -> bool:
    """Whether the process that had the item, or one beside it, died."""
    return isinstance(answer.exception(), BrokenProcessPool)
