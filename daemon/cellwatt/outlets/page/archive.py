"""Curves, past alarms and reports of one cell, from memory and from its recordings, which are read in threads."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Concatenate, Final, ParamSpec, TypeVar

import numpy as np

from cellwatt.alarms import Standing
from cellwatt.errors import OutletError
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page.levels.curves import curves
from cellwatt.outlets.page.levels.episodes import Episode, Memory, alarm_history
from cellwatt.outlets.page.levels.gathering import Samples, Span
from cellwatt.outlets.page.levels.store import Store

THREADS: Final = 2
WAITING: Final = 8
"""Largest number of requests that wait for a thread; further ones are refused."""

P = ParamSpec("P")
T = TypeVar("T")


class Desk:
    """Runs slow requests in threads, two at a time."""

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(THREADS, "page")
        self._open = 0

    async def ask(self, work: Callable[P, T], *args: P.args, **more: P.kwargs) -> T:
        """Run ``work`` in a thread. Raises ``OutletError`` if too many requests are waiting."""
        if self._open >= THREADS + WAITING:
            raise OutletError("too many requests for past data are waiting: try again in some seconds")
        self._open += 1
        doing = asyncio.get_running_loop().run_in_executor(self._threads, lambda: work(*args, **more))
        doing.add_done_callback(self._done)  # a browser that disconnects does not end the work
        return await asyncio.shield(doing)

    def _done(self, doing: asyncio.Future[Any]) -> None:
        self._open -= 1
        if not doing.cancelled():
            doing.exception()

    def close(self) -> None:
        """Discard waiting requests and wait for those that are running; blocks."""
        self._threads.shutdown(cancel_futures=True)


class Archive:
    """The recordings of a cell in ``folder``, ``None`` if it does not record, and ``reports`` in another folder.

    ``levels``: disk space, bytes, for the level files beside the recordings; they are written from ``start`` to
    ``close``.
    """

    def __init__(
        self, folder: Path | None, cell: str, reports: Path | None, desk: Desk, levels: float = math.inf
    ) -> None:
        self.folder, self._desk = folder, desk
        self._store = Store(folder, cell, levels)
        self.start, self.close, self.counts = self._store.start, self._store.close, self._store.counts
        self._folders = [found for found in (folder, reports) if found is not None]

    async def curves(
        self, live: LiveCell, channels: Sequence[str], start: float, end: float, points: int
    ) -> dict[str, Any]:
        """Curves, intervals and alarms from ``start`` to ``end``, UTC ms, including the last minute in memory."""
        return await self._desk.ask(curves, self._store, channels, start, end, points, in_memory(live, channels))

    async def alarms(self, live: LiveCell, start: float, end: float, limit: int) -> dict[str, Any]:
        """Alarms from ``start`` to ``end``, UTC ms, the newest first."""
        return await self._desk.ask(alarm_history, self._store, start, end, limit, in_memory(live))

    async def reports(self, ask: Callable[Concatenate[Sequence[Path], P], T], *args: P.args, **more: P.kwargs) -> T:
        """Result of ``ask``, a function of the module ``reports``, for the folders of this cell."""
        return await self._desk.ask(ask, self._folders, *args, **more)


def in_memory(live: LiveCell, channels: Sequence[str] = ()) -> Memory:
    """The last minute of ``channels``, and the intervals and alarms in memory."""
    between = np.diff(live.frames.time[-50:])
    found: dict[str, Samples] = {}
    for begin, last in {"": live.frames, **{f"prediction/{m}/": last for m, last in live.predicted.items()}}.items():
        columns = {begin + name: i for i, name in enumerate(last.names) if begin + name in channels}
        if columns:
            time, values = last.time, last.values
            found |= {channel: (time, values[:, i]) for channel, i in columns.items()}
    spans = [Span.of(interval) for interval in live.intervals]
    alarms = [_episode(standing) for standing in (*live.cleared, *live.alarms.up)]
    return Memory(int(between.min()) if len(between) else 0, found, spans, alarms, live.forgotten)


def _episode(standing: Standing) -> Episode:
    alarm, over = standing.alarm, None if standing.raised else standing.message
    episode = Episode(alarm, alarm, alarm.since, acknowledged=standing.acknowledgement)
    if over is not None:
        episode.end(over.time, over.statement)
    return episode
