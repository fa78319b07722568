"""What the record of one cell tells: curves, past alarms, reports; asked in threads, so that streams go on."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from cellwatt.errors import OutletError
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import fresh

THREADS: Final = 2
_TOLD: Final = ("over budget", "unwritten", "damaged")
WAITING: Final = 8
"""Questions that may wait for a thread; more are refused."""

P = ParamSpec("P")
T = TypeVar("T")


class Desk:
    """Answers slow questions, two at a time."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(THREADS, "page")
        self._open = 0

    async def ask(self, work: Callable[P, T], *args: P.args, **more: P.kwargs) -> T:
        """Do some work in a thread. Raises ``OutletError`` where too much is waiting already."""
        if self._open >= THREADS + WAITING:
            raise OutletError("too many questions about the past are waiting: ask again in some seconds")
        self._open += 1
        doing = asyncio.get_running_loop().run_in_executor(self._threads, lambda: work(*args, **more))
        doing.add_done_callback(self._done)  # a browser that leaves does not end the work
        return await asyncio.shield(doing)

    def _done(self, doing: asyncio.Future[Any]) -> None:
        self._open -= 1
        if not doing.cancelled():
            doing.exception()

    def close(self) -> None:
        """Begin nothing more, and wait for what is being done; blocks."""
        self._threads.shutdown(cancel_futures=True)


class Archive:
    """The record in ``folder`` of a cell, ``None`` where there is none, and ``reports`` in another folder.

    ``levels`` are the bytes that the level files beside the record may take.
    """

    def __init__(
        self, folder: Path | None, cell: str, reports: Path | None, desk: Desk, levels: float = math.inf
    ) -> None:
        self.folder, self._cell, self._desk = folder, cell, desk
        self._curves = None
        if folder is not None:
            from cellwatt.outlets.page.levels import Curves

            self._curves = Curves(folder, cell, levels)
        self._folders = [found for found in (folder, reports) if found is not None]

    def start(self) -> None:
        """Begin to follow the record."""
        if self._curves is not None:
            self._curves.start()

    def counts(self) -> dict[str, int]:
        """Level files that are missing, and why."""
        told = {} if self._curves is None else self._curves.store.counts
        return {f"level files {what}": told[what] for what in _TOLD if told.get(what)}

    def close(self) -> None:
        """End; blocks."""
        if self._curves is not None:
            self._curves.close()

    async def curves(
        self, live: LiveCell, channels: Sequence[str], start: float, end: float, points: int
    ) -> dict[str, Any]:
        """Curves from ``start`` to ``end`` ms, and what happened then; the last minute is from memory."""
        if self._curves is None:
            found = fresh.curves(live, channels, start, end, points)
            return {**found, **fresh.marks(None, live, start, end), "from_record": False, "complete": True}
        told = await self._desk.ask(self._curves.curves, channels, start, end, points)
        return {**fresh.joined(told, live, channels, start, end, points), **fresh.marks(told, live, start, end)}

    async def alarms(self, live: LiveCell, start: float, end: float, limit: int) -> dict[str, Any]:
        """Alarms from ``start`` to ``end`` ms, the newest first."""
        from cellwatt.outlets.page.past import alarm_history

        if self.folder is None:
            return fresh.alarms(live, start, end, limit)
        return await self._desk.ask(alarm_history, self.folder, self._cell, start, end, limit, self._curves)

    async def reports(self) -> dict[str, Any]:
        """All reports, the newest first."""
        from cellwatt.outlets.page.pages import list_reports

        return await self._desk.ask(list_reports, self._folders)

    async def report(self, path: str) -> Path | None:
        """The file of a report, ``None`` if there is none of that name."""
        from cellwatt.outlets.page.pages import report_file

        return await self._desk.ask(report_file, self._folders, path)

    async def mismatch(self) -> dict[str, Any]:
        """What the newest comparison with the simulation found."""
        from cellwatt.outlets.page.pages import newest_mismatch

        return await self._desk.ask(newest_mismatch, self._folders)
