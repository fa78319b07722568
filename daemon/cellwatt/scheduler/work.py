"""The items of one ``spread`` on the workers of a dask scheduler."""

from __future__ import annotations

import logging
import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from cellwatt.errors import CellwattError
from cellwatt.progress import Stage, aside
from cellwatt.scheduler.handed import Handed
from cellwatt.scheduler.parcel import pack, unpack
from cellwatt.scheduler.place import Place
from cellwatt.scheduler.quiet import distributed
from cellwatt.scheduler.task import FAILED, MISSING, call
from cellwatt.scheduler.versions import check_versions
from cellwatt.scheduler.workers import Workers

log = logging.getLogger(__name__)

AHEAD: Final = 2
"""Items that are with the scheduler for each thread of a worker: one that is worked on, one that waits."""
LONG: Final = 1.0
"""s after which the work looks up from waiting."""


class Work:
    """Items on their way: some with the scheduler, the results of others here. Used once, for its ``results``."""

    def __init__(
        self,
        client: Any,
        place: Place,
        function: Callable[..., Any],
        items: Sequence[Any],
        shared: Any,
        told: Stage,
    ) -> None:
        self._client, self._place, self._told = client, place, told
        self._function, self._items = function, items
        self._what, self._key = told.name, f"cellwatt-{uuid.uuid4().hex}"
        self._workers = Workers(client, place)
        self._handed = None if shared is None else Handed(client, self._key, shared)
        self._results: list[Any] = [None] * len(items)
        self._next, self._end = 0, len(items)
        """Numbers of the item to begin with next, and of the first that nobody needs: the one that failed."""
        self._error: Exception | None = None
        self._again: deque[int] = deque()
        """Items that came to a worker without the shared value."""
        self._suspects: deque[int] = deque()
        """Items whose workers died."""
        self._alone = False
        """A suspect is tried again with no other beside it, which would be suspected, too."""
        self._with: dict[Any, int] = {}
        """Numbers of the items that are with the scheduler, by their futures."""
        self._tries, self._folder = 0, str(Path.cwd())

    def results(self) -> list[Any]:
        """Results in the order of the items. Raises the error of the first that failed."""
        with self._reached():
            try:
                while self._with or self._again or self._suspects or self._next < self._end:
                    self._look()
                    self._fill()
                    self._take(self._finished())
            finally:
                self._with.clear()  # what nobody has a future of is cancelled
                self._handed = None
            self._workers.look()
        if self._workers.gone:
            with aside():
                log.warning("%s: %s in the middle; others did their part", self._what, self._workers)
        if self._error is not None:
            raise self._error
        return self._results

    def _look(self) -> None:
        self._workers.look(every=LONG)
        notes = (self._what, str(self._workers), "" if self._workers.threads else "waiting for a worker")
        self._told.name = ", ".join(filter(None, notes))

    def _fill(self) -> None:
        """Give the scheduler what its workers can begin with soon."""
        room = AHEAD * self._workers.threads - len(self._with)
        if self._alone or (self._handed is not None and self._handed.coming()):
            return
        if self._suspects:
            if not self._with and room:
                self._alone = True
                self._submit(self._suspects.popleft())
            return
        while room > 0 and (self._again or self._next < self._end):
            if self._again:
                self._submit(self._again.popleft())
            else:
                self._next += 1
                self._submit(self._next - 1)
            room -= 1

    def _submit(self, i: int) -> None:
        self._tries += 1
        name = None if self._handed is None else self._handed.name
        parcel = pack((self._function, self._items[i]))
        key = f"{self._key}-{i}-{self._tries}"
        self._with[self._client.submit(call, parcel, self._folder, name, key=key, pure=False)] = i

    def _finished(self) -> list[Any]:
        """Futures that are done, after a second at most."""
        awaited = [*self._with] + ([] if self._handed is None else self._handed.coming())
        if not awaited:
            time.sleep(LONG / 10)  # there is no worker
            return []
        with suppress(TimeoutError), self._client.as_current():
            distributed.wait(awaited, LONG, "FIRST_COMPLETED")
        return [future for future in self._with if future.done()]

    def _take(self, done: Sequence[Any]) -> None:
        good = [future for future in done if future.status == "finished"]
        for future, (kind, content) in zip(good, self._client.gather(good), strict=True):
            self._settle(self._with.pop(future), kind, content)
        for future in done:
            if future in self._with:
                self._suspect(self._with.pop(future), future.exception())
        if self._error is not None:
            self._with = {future: i for future, i in self._with.items() if i < self._end}
            self._again = deque(i for i in self._again if i < self._end)
            self._suspects = deque(i for i in self._suspects if i < self._end)
        self._told.done = float(self._next - len(self._with) - len(self._again) - len(self._suspects))

    def _settle(self, i: int, kind: str, content: Any) -> None:
        if kind == MISSING and self._handed is not None:
            self._handed.give(content)
            (self._suspects if self._alone else self._again).append(i)
        elif kind != FAILED:
            self._results[i] = unpack(content)
        elif i < self._end:
            self._end, self._error = i, unpack(content)
        self._alone = False

    def _suspect(self, i: int, error: BaseException) -> None:
        """Handle an item that could not be done, for a reason which is not the function's."""
        item = f"{self._what}: item {i + 1} of {len(self._items)} ({_short(self._items[i])})"
        if not isinstance(error, distributed.scheduler.KilledWorker):
            check_versions(self._client, self._place)  # of workers that have come since
            raise CellwattError(f"{item} cannot be done by {self._place}: {type(error).__name__}: {error}")
        if self._alone:
            raise CellwattError(f"{item} kills each worker that takes it: have they enough memory?")
        self._suspects.append(i)

    @contextmanager
    def _reached(self) -> Iterator[None]:
        """Put into words that the scheduler is gone."""
        try:
            yield
        except (CancelledError, OSError, distributed.client.ClosedClientError) as error:
            again = "" if self._place.address is None else ": start it again, then this command"
            raise CellwattError(f"{self._what}: {self._place} is gone, or has dropped this work{again}") from error


def _short(item: object) -> str:
    text = " ".join(repr(item).split())
    return text if len(text) <= 100 else f"{text[:99]}…"
