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
from cellwatt.live.history import SPAN, History
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import shapes

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
            found = curves(live, channels, start, end, points)
            return {**found, **marks(None, live, start, end), "from_record": False, "complete": True}
        told = await self._desk.ask(self._curves.curves, channels, start, end, points)
        return {**joined(told, live, channels, start, end, points), **marks(told, live, start, end)}

    async def alarms(self, live: LiveCell, start: float, end: float, limit: int) -> dict[str, Any]:
        """Alarms from ``start`` to ``end`` ms, the newest first."""
        from cellwatt.outlets.page.levels.telling import alarm_history

        if self.folder is None:
            return alarms(live, start, end, limit)
        store = None if self._curves is None else self._curves.store
        return await self._desk.ask(alarm_history, self.folder, self._cell, start, end, limit, store)

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


PREDICTED: Final = "prediction/"
"""Begin of the name of a model's output among channels: ``prediction/<model>/<output>``."""
_NS: Final = 1e6
"""ns in a ms."""

Drawn = dict[str, Any]


def curves(live: LiveCell, channels: Sequence[str], start: float, end: float, points: int) -> Drawn:
    """Least and most of channels in at most ``points`` equal spans from ``start`` to ``end`` ms, from memory alone.

    A span holds whole steps of the frames; ``min`` alone where it is one.
    """
    step = _step(live.frames)
    wide = max(step, math.ceil((end - start) / max(1, points) / step - 1e-9) * step)
    first = math.floor(start / wide) * wide
    count = min(max(1, points), max(0, math.ceil((end - first) / wide)))
    found = {name: _bins(live, name, first, wide, count) for name in channels}
    times = first + wide * np.arange(count)
    known = np.zeros(count, bool)
    for low, _ in found.values():
        known |= np.isfinite(low)
    values = {}
    for name, (low, high) in found.items():
        values[name] = {"min": _plain(low[known])} | ({"max": _plain(high[known])} if wide > step else {})
    return {"t": times[known].tolist(), "v": values, "step_ms": wide}


def joined(record: Drawn, live: LiveCell, channels: Sequence[str], start: float, end: float, points: int) -> Drawn:
    """Curves from the record whose end is replaced by what is in memory, which is newer and whole."""
    wide, times = record["step_ms"], record["t"]
    held = live.frames.time
    if not len(held) or 2 * wide > SPAN * 1e3:
        return record
    if not times or wide <= 0:  # nothing was recorded then
        return {**record, **curves(live, channels, start, end, points)}
    begin = held[0] / _NS
    first = times[0] + math.ceil((begin - times[0]) / wide) * wide  # the first span that memory holds from its start
    count = max(0, math.ceil((end - first) / wide))
    kept = int(np.searchsorted(times, first - wide / 2))
    found = {name: _bins(live, name, first, wide, count) for name in channels}
    known = np.zeros(count, bool)
    for low, _ in found.values():
        known |= np.isfinite(low)
    newer = (first + wide * np.arange(count))[known].tolist()
    values = {}
    for name in channels:
        before = record["v"].get(name) or {}
        low, high = found[name]
        part = {"min": [*_at_least(before.get("min"), kept), *_plain(low[known])]}
        if wide > _step(live.frames) + 1e-6:
            highest = before.get("max", before.get("min"))
            part["max"] = [*_at_least(highest, kept), *_plain(high[known])]
        values[name] = part
    found_times = [*times[:kept], *newer]
    return {**record, "t": found_times, "v": values} if len(found_times) <= max(points, len(times)) else record


def marks(record: Drawn | None, live: LiveCell, start: float, end: float) -> dict[str, Any]:
    """Intervals and alarms from ``start`` to ``end`` ms, of the record and of memory, each once."""
    intervals = {} if record is None else {(i["source"], i["number"]): i for i in record["intervals"]}
    for body in live.intervals:
        told = shapes.interval(body)
        if told["start"] <= end and told["end"] >= start:
            intervals.setdefault((told["source"], told["number"]), told)
    held = [told for told in map(_mark, (*live.cleared, *live.alarms.up)) if _overlap(told, start, end)]
    # Memory knows since when, the record when it was told, and by its stage: there it may come and go meanwhile.
    known = [] if record is None else [a for a in record["alarms"] if not any(_same(a, told) for told in held)]
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


def _step(history: History) -> float:
    """Step of frames, ms: the least between two of the last ones."""
    between = np.diff(history.time[-50:])
    return float(between.min()) / _NS if len(between) else 20.0


def _bins(
    live: LiveCell, channel: str, first: float, wide: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and most (count,) of a channel in spans of ``wide`` ms from ``first`` ms; NaN where there is nothing."""
    low, high = np.full(count, np.nan), np.full(count, np.nan)
    history, column = _place(live, channel)
    if history is None or column not in history.names or not count:
        return low, high
    span = np.round((history.time - round(first * _NS)) / (wide * _NS), 6)
    rows = slice(*np.searchsorted(span, (0.0, float(count))))
    places = span[rows].astype(np.int64)
    values = history.of(column)[rows]
    np.fmin.at(low, places, values)
    np.fmax.at(high, places, values)
    return low, high


def _place(live: LiveCell, channel: str) -> tuple[History | None, str]:
    if not channel.startswith(PREDICTED):
        return live.frames, channel
    model, _, output = channel.removeprefix(PREDICTED).rpartition("/")
    predicted: Mapping[str, History] = live.predicted
    return predicted.get(model), output


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return np.where(np.isfinite(values), values, None).tolist()  # type: ignore[call-overload,no-any-return]


def _at_least(values: Sequence[float | None] | None, count: int) -> list[float | None]:
    """The first ``count`` values, ``None`` where there are fewer."""
    kept = list(values[:count]) if values is not None else []
    return kept + [None] * (count - len(kept))
