"""The thread that makes level files of closed recordings, slowly, and follows the open one."""

from __future__ import annotations

import logging
import math
import threading
import time
from typing import Final

from cellwatt.errors import CellwattError, why
from cellwatt.outlets.page.levels.store import Growing, Store

log = logging.getLogger(__name__)

PERIOD: Final = 2.0
"""s from one look at the folder to the next."""
WORK, REST = 0.01, 0.03
"""s of reading, and of rest after it: the page's other threads go first."""


class _Over(Exception):  # noqa: N818
    pass


class Keeper:
    """Keeps a store up to date from ``start`` to ``close``."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._rest_at = 0.0
        self.looks = 0
        """Looks at the folder that are done."""

    def start(self) -> None:
        """Begin."""
        self._over.clear()
        self._thread = threading.Thread(target=self._run, name="levels", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End, in the middle of a recording if need be."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def look(self) -> None:
        """Look at the folder once: take what is new, make what is missing, newest first, remove what is over."""
        store = self._store
        recordings = store.recordings()
        for kept in recordings:
            if kept.closed:
                store.finish(kept)
            else:
                self._follow(store.growing(kept))
        if store.room():
            store.let_go()
            for kept in reversed(recordings):
                if kept.closed and store.budget.allows(kept.name):
                    store.made(kept, math.inf, self._pace)
        store.tidy()

    def _follow(self, growing: Growing) -> None:
        """Take what is new, a little at a time, so that nobody waits long for the lock."""
        whole = False
        while not whole:
            with growing.lock:
                try:
                    whole = growing.grow(time.monotonic() + WORK)
                except FileNotFoundError:
                    return  # repaired, or removed
            if self._over.wait(0 if whole else REST):
                raise _Over

    def _run(self) -> None:
        while not self._over.is_set():
            try:
                self.look()
            except _Over:
                return
            except OSError as error:
                self._wrong(why(error))
            except CellwattError as error:
                self._wrong(str(error))
            self.looks += 1
            self._over.wait(PERIOD)

    def _wrong(self, reason: str) -> None:
        self._store.counts["failed looks"] += 1
        self._store.problem = reason
        log.warning("the record cannot be followed: %s", reason)

    def _pace(self) -> None:
        """Rest after some work; end where all is to end."""
        now = time.monotonic()
        if now < self._rest_at:
            return
        if self._over.wait(REST):
            raise _Over
        self._rest_at = time.monotonic() + WORK
