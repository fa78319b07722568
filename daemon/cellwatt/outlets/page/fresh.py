"""Curves of the last minute, and their place at the end of curves from the record. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.alarms import Standing
from cellwatt.live.history import SPAN, History
from cellwatt.live.state import LiveCell
from cellwatt.outlets.page import shapes

PREDICTED: Final = "prediction/"
"""Begin of the name of a model's output among channels: ``prediction/<model>/<output>``."""
_NS: Final = 1e6
"""ns in a ms."""

Curves = dict[str, Any]


def curves(live: LiveCell, channels: Sequence[str], start: float, end: float, points: int) -> Curves:
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


def joined(record: Curves, live: LiveCell, channels: Sequence[str], start: float, end: float, points: int) -> Curves:
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


def marks(record: Curves | None, live: LiveCell, start: float, end: float) -> dict[str, Any]:
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
