"""Intervals and alarms of a span."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from cellwatt.outlets.page.levels.episodes import Episode, episodes
from cellwatt.outlets.page.levels.gathering import Intervals
from cellwatt.outlets.page.levels.sources import Source
from cellwatt.outlets.page.levels.store import Store, near
from cellwatt.outlets.page.shapes import ms
from cellwatt.record.retention import Kept

MOST: Final = 2000
"""Intervals, and alarms, that an answer has at most: the longest intervals, the newest alarms."""


def marks(store: Store, recordings: Sequence[Kept], start: int, end: int, until: float) -> dict[str, Any]:
    """Intervals and alarms from ``start`` to before ``end`` UTC ns, as far as they are read before ``until``.

    Recordings of long before are asked only if they have a level file: an alarm that is still up may stand there.
    """
    sources, complete = read(store, recordings, start, end, until)
    rows: dict[tuple[int, str, int], dict[str, Any]] = {}
    for kept, source in sources:
        if source.start < end and source.end >= start:
            try:
                rows |= _rows(kept.name.session, source.intervals(), start, end)
            except FileNotFoundError:
                pass  # removed with its recording
            except ValueError as error:
                store.spoiled(kept, str(error))
                complete = False
    alarms = [e for e in together(recordings, sources) if e.overlaps(start, end)]
    complete = complete and len(rows) <= MOST and len(alarms) <= MOST
    longest = sorted(rows.values(), key=lambda row: row["end"] - row["start"])[-MOST:]
    return {
        "intervals": sorted(longest, key=lambda row: row["start"]),
        "alarms": [_mark(episode) for episode in alarms[-MOST:]],
        "complete": complete,
    }


def read(
    store: Store, recordings: Sequence[Kept], start: int, end: int, until: float
) -> tuple[list[tuple[Kept, Source]], bool]:
    """Recordings begun before ``end`` with their sources, in order, and true if these are all.

    The newest are read first, until monotonic time ``until``; those written before ``start`` only from level files.
    """
    wanted = {kept.path for kept in near(recordings, start, end)}
    found: list[tuple[Kept, Source]] = []
    complete = True
    for kept in reversed(recordings):
        if kept.name.session >= end:
            continue
        try:
            source = store.telling(kept, until if kept.path in wanted else 0.0)
        except TimeoutError:
            complete = False
            continue
        if source is not None:
            found.append((kept, source))
    return found[::-1], complete


def together(recordings: Sequence[Kept], sources: Sequence[tuple[Kept, Source]]) -> list[Episode]:
    """Alarms from raise to clear, out of all sources in order."""
    sessions = sorted({kept.name.session for kept in recordings})
    return episodes(((kept.name.session, source.said) for kept, source in sources), sessions)


def _rows(session: int, intervals: Intervals, start: int, end: int) -> dict[tuple[int, str, int], dict[str, Any]]:
    """Intervals by session, source and number: of one that ran on into the next recording that has the last of it."""
    rows = {}
    spans, whats = intervals.within(start, end)
    for first, last, number, what in spans.tolist():
        source, moving, closed = whats[what]
        told = {"source": source, "number": number, "start": ms(first), "end": ms(last)}
        rows[session, source, number] = {**told, "moving": list(moving), "closed": closed}
    return rows


def _mark(episode: Episode) -> dict[str, Any]:
    alarm = episode.alarm
    told = {"id": alarm.id, "severity": alarm.severity, "statement": alarm.statement}
    return {**told, "raised": ms(episode.raised), "cleared": ms(episode.cleared)}
