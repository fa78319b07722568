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
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from cellwatt.child import end_with
from cellwatt.errors import CellwattError
from cellwatt.progress import Stage
from cellwatt.scheduler.parcel import call, parcels, result, shortened


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
        """Results in the order of the items. Raises as ``spread``; ``CellwattError`` where a worker is killed."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._count, context, initializer=_begin, initargs=(os.getpid(),))
        kept, folder = self._shared(shared), str(Path.cwd())
        results: list[Any] = []
        try:
            answers = [self._pool.submit(call, parcel, folder, kept) for parcel in parcels(function, items)]
            for answer in answers:
                results.append(result(answer.result()))
                told.done = float(len(results))
        except BrokenProcessPool as error:
            self._end()
            near = (
                f"{told.name}, at item {len(results) + 1} of {len(items)} ({shortened(items[len(results)])}) or later"
            )
            raise CellwattError(f"{near}: a worker process was killed: is there enough memory?") from error
        except BaseException:
            self._end()  # what has begun is needed by nobody
            raise
        finally:
            if kept is not None:
                kept.unlink()
        return results

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
