"""What memory and the record tell of one cell: curves, past alarms, reports; the record is asked in threads."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from cellwatt.alarms import Standing
from cellwatt.errors import OutletError
from cellwatt.live.last_minute import LastMinute
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.levels.curves import Curves
from cellwatt.outlets.page.levels.episodes import alarm_history
from cellwatt.outlets.page.reports import list_reports, newest_mismatch, report_file

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
        self.folder, self._desk = folder, desk
        self._curves = Curves(folder, cell, levels)
        self._folders = [found for found in (folder, reports) if found is not None]

    def start(self) -> None:
        """Begin to follow the record."""
        if self.folder is not None:
            self._curves.keeper.start()

    def counts(self) -> dict[str, int]:
        """Level files that are missing, and why."""
        told = self._curves.store.counts
        return {f"level files {what}": told[what] for what in _TOLD if told.get(what)}

    def close(self) -> None:
        """End; blocks."""
        self._curves.keeper.close()

    async def curves(
        self, live: LiveCell, channels: Sequence[str], start: float, end: float, points: int
    ) -> dict[str, Any]:
        """Curves from ``start`` to ``end`` ms, and what happened then; the last minute is in memory as well."""
        told = await self._desk.ask(self._curves.curves, channels, start, end, points, in_memory(live, channels))
        return {**told, **marks(told, live, start, end)}

    async def alarms(self, live: LiveCell, start: float, end: float, limit: int) -> dict[str, Any]:
        """Alarms from ``start`` to ``end`` ms, the newest first."""
        if self.folder is None:
            return alarms(live, start, end, limit)
        return await self._desk.ask(alarm_history, self._curves.store, start, end, limit)

    async def reports(self) -> dict[str, Any]:
        """All reports, the newest first."""
        return await self._desk.ask(list_reports, self._folders)

    async def report(self, path: str) -> Path | None:
        """The file of a report, ``None`` if there is none of that name."""
        return await self._desk.ask(report_file, self._folders, path)

    async def mismatch(self) -> dict[str, Any]:
        """What the newest comparison with the simulation found."""
        return await self._desk.ask(newest_mismatch, self._folders)


PREDICTED: Final = "prediction/"
"""Begin of the name of a model's output among channels: ``prediction/<model>/<output>``."""


def in_memory(live: LiveCell, channels: Sequence[str]) -> tuple[int, dict[str, tuple[NDArray[Any], NDArray[Any]]]]:
    """Step of the frames, ns, and times, UTC ns, and values of channels in the last minute."""
    between = np.diff(live.frames.time[-50:])
    found = {}
    for channel in channels:
        history, column = _place(live, channel)
        if history is not None and column in history.names:
            found[channel] = history.time.copy(), history.of(column).copy()
    return int(between.min()) if len(between) else 0, found


def marks(record: Mapping[str, Any], live: LiveCell, start: float, end: float) -> dict[str, Any]:
    """Intervals and alarms from ``start`` to ``end`` ms, of the record and of memory, each once."""
    intervals = {(i["source"], i["number"]): i for i in record["intervals"]}
    for body in live.intervals:
        told = shapes.span("interval", body)
        if told["start"] <= end and told["end"] >= start:
            intervals.setdefault((told["source"], told["number"]), told)
    held = [told for told in map(_mark, (*live.cleared, *live.alarms.up)) if _overlap(told, start, end)]
    # Memory knows since when, the record when it was told, and by its stage: there it may come and go meanwhile.
    known = [alarm for alarm in record["alarms"] if not any(_same(alarm, told) for told in held)]
    return {"intervals": list(intervals.values()), "alarms": [*known, *held]}


def alarms(live: LiveCell, start: float, end: float, limit: int) -> dict[str, Any]:
    """Alarms in memory that were up from ``start`` to ``end`` ms, the newest first."""
    found = []
    for standing in reversed((*live.cleared, *live.alarms.up)):
        if _overlap(span := _mark(standing), start, end):
            over = None if standing.over is None or standing.raised else standing.over.statement
            told = shapes.alarm(standing.alarm, standing.acknowledgement, None)
            told |= {"active": standing.raised, "time": shapes.ms(standing.message.time), "people": []}
            found.append({**told, "cleared": span["cleared"], "cleared_statement": over})
    return {"alarms": found[:limit], "complete": len(found) <= limit and not live.forgotten}


def _mark(standing: Standing) -> dict[str, Any]:
    return shapes.mark(standing.alarm, standing.alarm.since, None if standing.raised else standing.message.time)


def _overlap(told: Mapping[str, Any], start: float, end: float) -> bool:
    """True if an alarm was up at any time from ``start`` to ``end`` ms."""
    return bool(told["raised"] <= end and (told["cleared"] is None or told["cleared"] >= start))


def _same(recorded: Mapping[str, Any], told: Mapping[str, Any]) -> bool:
    """True if two marks are of one alarm."""
    until = math.inf if told["cleared"] is None else told["cleared"]
    return bool(recorded["id"] == told["id"] and _overlap(recorded, told["raised"], until))


def _place(live: LiveCell, channel: str) -> tuple[LastMinute | None, str]:
    if not channel.startswith(PREDICTED):
        return live.frames, channel
    model, _, output = channel.removeprefix(PREDICTED).rpartition("/")
    predicted: Mapping[str, LastMinute] = live.predicted
    return predicted.get(model), output
