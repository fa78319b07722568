"""The workers of a scheduler: how many there are, and how many have gone."""

from __future__ import annotations

import time
from concurrent.futures import CancelledError
from typing import Any, Final

from cellwatt.errors import CellwattError
from cellwatt.scheduler.place import Place
from cellwatt.scheduler.versions import check_versions

WORKERLESS: Final = 60.0
"""s without any worker that end the work."""


class Workers:
    """What a scheduler says of its workers, now and then. Its text says how many have gone, if any."""

    def __init__(self, client: Any, place: Place) -> None:
        self._client, self._place = client, place
        self._there: set[str] = set()
        self._looked, self._seen = float("-inf"), time.monotonic()
        self.threads = 0
        """Items that all of them can do at once."""
        self.gone = 0

    def __str__(self) -> str:
        return f"{self.gone} worker{'' if self.gone == 1 else 's'} went away" if self.gone else ""

    def look(self, every: float = 0.0) -> None:
        """Ask the scheduler, unless that was done less than ``every`` s ago.

        Raises ``CellwattError`` for one that has come with another version of what gives the results, and after a
        minute without any; ``CancelledError`` where the scheduler is gone.
        """
        now = time.monotonic()
        if now - self._looked < every:
            return
        about = self._client.scheduler_info()
        if self._client.status != "running":
            raise CancelledError
        there = set(about["workers"])
        if there - self._there:
            check_versions(self._client, self._place)
        self.gone += len(self._there - there)
        self.threads = sum(int(worker["nthreads"]) for worker in about["workers"].values())
        self._there, self._looked = there, now
        if there:
            self._seen = now
        elif now - self._seen > WORKERLESS:
            start = f"; start one with: dask worker {self._place.address}" if self._place.address else ""
            raise CellwattError(f"{self._place} has had no worker for {WORKERLESS:.0f} s{start}")
