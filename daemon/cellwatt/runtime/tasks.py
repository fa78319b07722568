"""Named tasks that are started and ended one by one."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Iterable, Iterator
from typing import Any

from cellwatt.errors import CellwattError

log = logging.getLogger(__name__)

DRAIN = 5.0
"""Longest time, s, that a stop waits for a task to finish its queue."""


@contextlib.contextmanager
def plain_errors() -> Iterator[None]:
    """Raise the first error of a group of tasks, however deep, on its own if all of them are ``CellwattError``."""
    try:
        yield
    except ExceptionGroup as failures:
        if failures.split(CellwattError)[1] is None:
            first: Exception = failures
            while isinstance(first, ExceptionGroup):
                first = first.exceptions[0]
            raise first from None
        raise


async def end_of(
    work: Callable[[], Coroutine[Any, Any, None]], expected: type[Exception], broke: str
) -> Exception | asyncio.CancelledError | None:
    """Run ``work``; return the exception that ended it, or None. An exception not ``expected`` is logged as ``broke``.

    A cancellation of this task is raised, however ``work`` ends; one that comes from within a library counts as an
    unexpected exception.
    """
    error: Exception | asyncio.CancelledError | None = None
    try:
        await work()
    except (Exception, asyncio.CancelledError) as raised:
        error = raised
    task = asyncio.current_task()
    stops = task is not None and task.cancelling() > 0
    if error is not None and not isinstance(error, (expected, asyncio.CancelledError) if stops else expected):
        log.error("%s", broke, exc_info=error)
    if stops:
        raise asyncio.CancelledError from error
    return error


class Tasks:
    """Tasks of a group by name."""

    def __init__(self, group: asyncio.TaskGroup) -> None:
        self._group = group
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def spawn(self, name: str, work: Coroutine[Any, Any, None]) -> None:
        """Start a task."""
        self._tasks[name] = self._group.create_task(work, name=name)

    async def end(self, names: Iterable[str]) -> None:
        """Cancel tasks and wait for them; one that does not end within ``DRAIN`` s is logged and abandoned."""
        tasks = [self._tasks.pop(name) for name in list(names) if name in self._tasks]
        for task in tasks:
            task.cancel()
        for task in (await asyncio.wait(tasks, timeout=DRAIN))[1] if tasks else ():
            log.warning("%s did not end within %.0f s: it is abandoned", task.get_name(), DRAIN)
            task.cancel()
