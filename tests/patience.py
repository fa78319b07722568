"""How long a test waits, at most, for what must happen: always for a condition, never for a count of tries.

``CELLWATT_TEST_PATIENCE`` multiplies every wait and the limit of each test, for a machine that is slow or busy.
"""

from __future__ import annotations

import asyncio
import inspect
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

FACTOR = float(os.environ.get("CELLWATT_TEST_PATIENCE", "1"))
PATIENCE = 60.0 * FACTOR
"""s; far above what an idle machine needs, so that only what never happens runs into it."""

PAUSE = 0.02


def wait_until(condition: Callable[[], Any], what: str = "what is waited for", seconds: float = PATIENCE) -> Any:
    """What the condition gives as soon as it holds; AssertionError where it never does."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, f"not within {seconds:g} s: {what}"
        time.sleep(0.01)
    return found


async def eventually(condition: Callable[[], Any], what: str = "what is waited for", seconds: float = PATIENCE) -> Any:
    """The same on an event loop; the condition may be one to await."""
    end = time.monotonic() + seconds
    while not (found := await got if inspect.isawaitable(got := condition()) else got):
        assert time.monotonic() < end, f"not within {seconds:g} s: {what}"
        await asyncio.sleep(0.005)
    return found


class Machine:
    """How late this machine wakes a thread that then syncs a file in ``folder``, at most, while the context lasts.

    A bound in time must be granted that. In s.
    """

    def __init__(self, folder: Path) -> None:
        self.late = 0.0
        self._file = folder / "machine"
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Machine:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()

    def _watch(self) -> None:
        with self._file.open("wb", buffering=0) as file:
            began = time.monotonic()
            while not self._over.wait(PAUSE):
                file.write(b".")
                os.fsync(file.fileno())
                self.late = max(self.late, time.monotonic() - began - PAUSE)
                began = time.monotonic()
