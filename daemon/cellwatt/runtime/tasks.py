"""Named tasks that are begun and ended one by one."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Coroutine, Iterable, Iterator
from typing import Any

from cellwatt.errors import CellwattError

log = logging.getLogger(__name__)

DRAIN = 5.0
"""Longest time, s, that a stop waits for a part to finish what is queued."""


@contextlib.contextmanager
def plain_errors() -> Iterator[None]:
    """Raise by itself the first error of a group of tasks, however deep, where all are meant for a person."""
    try:
        yield
    except ExceptionGroup as failures:
        if failures.split(CellwattError)[1] is None:
            raise next(_leaves(failures)) from None
        raise


def _leaves(failure: Exception) -> Iterator[Exception]:
    if isinstance(failure, ExceptionGroup):
        for inner in failure.exceptions:
            yield from _leaves(inner)
    else:
        yield failure


async def end_of(
    work: Callable[[], Coroutine[Any, Any, None]], expected: type[Exception], broke: str
) -> Exception | asyncio.CancelledError | None:
    """What ended ``work``: None where it came to its end; what is not ``expected`` is a mistake, logged as ``broke``.

    The end that was asked of this task is raised; one that a library asked of itself is a mistake, too.
    """
    try:
        await work()
    except expected as error:
        return error
    except (Exception, asyncio.CancelledError) as error:
        task = asyncio.current_task()
        if isinstance(error, asyncio.CancelledError) and task is not None and task.cancelling() > 0:
            raise
        log.exception("%s", broke)
        return error
    return None


class Tasks:
    """Tasks of a group by name."""

    def __init__(self, group: asyncio.TaskGroup) -> None:
        self._group = group
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def spawn(self, name: str, work: Coroutine[Any, Any, None]) -> None:
        """Begin a task."""
        self._tasks[name] = self._group.create_task(work, name=name)

    async def end(self, names: Iterable[str]) -> None:
        """Cancel tasks and wait for them; one that does not let go within ``DRAIN`` is told and left."""
        tasks = [self._tasks.pop(name) for name in list(names) if name in self._tasks]
        for task in tasks:
            task.cancel()
        for task in (await asyncio.wait(tasks, timeout=DRAIN))[1] if tasks else ():
            log.warning("%s did not end within %.0f s: it is cut off", task.get_name(), DRAIN)
            task.cancel()
