"""Intervals and alarms of a span, from recordings; alarms from raise to clear, with acknowledgements and shelving."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path
from typing import Any, Final

from cellwatt.alarms import RESTARTED, Acknowledgement
from cellwatt.errors import RecordingError, why
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.levels.buckets import span_of
from cellwatt.outlets.page.levels.following import Pace
from cellwatt.outlets.page.levels.gathering import Samples, Span
from cellwatt.outlets.page.levels.store import Source, Store, ends_at, near
from cellwatt.outlets.page.shapes import mark, ms
from cellwatt.record import packs
from cellwatt.record.folder import RecordFile
from cellwatt.record.header import FileName
from cellwatt.record.reader import EVER
from cellwatt.results import Alarm, Event

MOST: Final = 2000
"""Largest number of intervals, and of alarms, in an answer: the longest intervals, the newest alarms."""
PATIENCE: Final = 10.0
"""Time, s, after which the answer is returned incomplete."""

Found = Mapping[FileName, tuple[Sequence[Alarm | Event], Sequence[Span]]]
"""Alarms and their events, and intervals, of each recording."""


@dataclass
class Episode:
    """One alarm: its ``first`` message, its newest active message, times in UTC ns, and users' events about it.

    ``cleared`` is None while the alarm is active.
    """

    first: Alarm
    alarm: Alarm
    raised: int
    cleared: int | None = None
    cleared_statement: str | None = None
    acknowledged: Acknowledgement | None = None
    words: list[Event] = field(default_factory=list)
    pack: str | None = None
    """File name of the evidence, as reported by the daemon."""

    def overlaps(self, start: int, end: int) -> bool:
        """True if the alarm was active at some time from ``start`` to before ``end``, UTC ns."""
        return self.raised < end and (self.cleared is None or self.cleared >= start)

    def is_part_of(self, other: Episode) -> bool:
        """True if it is part of ``other``, the complete episode of the same alarm in memory."""
        return self.first.id == other.first.id and self.overlaps(
            other.raised, EVER if other.cleared is None else other.cleared + 1
        )

    def end(self, time: int, statement: str) -> None:
        """Set the end of the alarm, unless it is set already."""
        if self.cleared is None:
            self.cleared, self.cleared_statement = time, statement


@dataclass(frozen=True)
class Memory:
    """The most recent data, which may not be recorded yet.

    ``step`` of the frames, ns; samples by channel; intervals (UTC ns); alarms; ``forgotten``: number of older alarms
    that were discarded.
    """

    step: int = 0
    samples: Mapping[str, Samples] = field(default_factory=dict)
    spans: Sequence[Span] = ()
    alarms: Sequence[Episode] = ()
    forgotten: int = 0


def episodes(recordings: Sequence[RecordFile], found: Found) -> list[Episode]:
    """Alarms by time of raise, from messages in order; the start of a session ends the alarms of the one before."""
    by_id: dict[str, list[Episode]] = {}
    sessions = sorted({kept.name.session for kept in recordings})
    for session, group in groupby(sorted(found), key=lambda name: name.session):
        for message in (message for name in group for message in found[name][0]):
            if isinstance(message, Alarm):
                _hear(message, by_id.setdefault(message.id, []))
            else:
                _note(message, by_id)
        if (following := next((other for other in sessions if other > session), None)) is not None:
            for known in by_id.values():
                known[-1].end(max(following, known[-1].alarm.time), RESTARTED)
    return sorted((episode for known in by_id.values() for episode in known), key=lambda episode: episode.raised)


def _hear(alarm: Alarm, known: list[Episode]) -> None:
    """Add a message of an alarm: it begins, updates or ends an episode."""
    up = known[-1] if known and known[-1].cleared is None else None
    if up is not None and up.alarm.since != alarm.since and alarm.active:
        up.end(alarm.since, alarm.statement)  # its clear message is lost
        up = None
    if up is None:
        up = Episode(alarm, alarm, alarm.time if alarm.active else alarm.since)
        known.append(up)
    if alarm.active:
        up.alarm = alarm
    else:
        up.end(alarm.time, alarm.statement)


def _note(event: Event, known: Mapping[str, Sequence[Episode]]) -> None:
    """Add an event to its alarms: to the last episode of each id; evidence to the first episode without evidence."""
    ids = event.data.get("alarms", [event.data.get("alarm")])
    for raised in (known[alarm_id] for alarm_id in ids if alarm_id in known):
        if event.kind != "evidence":
            raised[-1].words.append(event)
        elif "pack" in event.data:
            start = event.data.get("start", 0)
            inside = (episode for episode in raised if episode.raised >= start and episode.pack is None)
            next(inside, raised[-1]).pack = str(event.data["pack"])


def marks(
    store: Store, recordings: Sequence[RecordFile], start: int, end: int, pace: Pace, memory: Memory
) -> dict[str, Any]:
    """Intervals and alarms from ``start`` to before ``end``, UTC ns, as far as ``pace`` allows reading.

    Much older recordings are read only if they have a level file: they may contain an alarm that is still active.
    """
    rows = {(span.source, span.number, span.start): span for span in memory.spans if span.overlaps(start, end)}
    found, complete = read(store, recordings, start, end, pace, intervals=True)
    for name in sorted(found):  # the later recording overrides an interval that continues in it
        spans = (span for span in found[name][1] if span.overlaps(start, end))
        rows |= {(span.source, span.number, span.start): span for span in spans}
    held = [episode for episode in memory.alarms if episode.overlaps(start, end)]
    # Memory has the start of an alarm; the record has the times of its messages, per stage, with possible gaps.
    known = [e for e in episodes(recordings, found) if e.overlaps(start, end) and not any(map(e.is_part_of, held))]
    alarms = [*known, *held]
    longest = sorted(rows.values(), key=lambda span: span.end - span.start)[-MOST:]
    return {
        "intervals": [
            {**span._asdict(), "start": ms(span.start), "end": ms(span.end), "moving": list(span.moving)}
            for span in sorted(longest, key=lambda span: span.start)
        ],
        "alarms": [mark(e.alarm, e.raised, e.cleared) for e in alarms[-MOST:]],
        "complete": complete and len(rows) <= MOST and len(alarms) <= MOST,
    }


def read(
    store: Store, recordings: Sequence[RecordFile], start: int, end: int, pace: Pace, *, intervals: bool = False
) -> tuple[Found, bool]:
    """Data of recordings begun before ``end``, with ``intervals`` if requested; True if they are complete.

    The newest are read first, until ``pace`` raises ``TimeoutError``; those before ``start`` only from level files.
    """
    wanted = {kept.path for kept in near(recordings, start, end)}
    found: dict[FileName, tuple[Sequence[Alarm | Event], Sequence[Span]]] = {}
    complete = True

    def ask(source: Source) -> tuple[Sequence[Alarm | Event], Sequence[Span]]:
        inside = intervals and source.start < end and source.end >= start
        return source.said, source.intervals() if inside else ()

    for kept in reversed(recordings):
        if kept.name.session < end:
            try:
                told = store.read(kept, pace if kept.path in wanted else ends_at(0.0), ask, curves=False)
            except TimeoutError:
                complete = False
                continue
            if told is not None:
                found[kept.name] = told
    return found, complete


def alarm_history(
    store: Store, start_ms: float, end_ms: float, limit: int, memory: Memory = Memory()
) -> dict[str, Any]:
    """Alarms active from ``start_ms`` to ``end_ms``, UTC ms, at most ``limit``, the newest first, ready for JSON.

    Without recordings they come from ``memory``. ``evidence_page`` is the path of the page below the route of reports.
    ``complete`` is false if older alarms are left out. Never call it on an event loop.

    Raises ``RecordingError`` if the folder cannot be read.
    """
    start, end = span_of(start_ms, end_ms)
    recordings = store.recordings()
    try:
        said, complete = read(store, recordings, start, end, ends_at(time.monotonic() + PATIENCE))
    except OSError as error:
        raise RecordingError(f"record.folder {store.folder} cannot be read: {why(error)}") from error
    known = episodes(recordings, said) if store.recorded else memory.alarms
    complete = complete and (store.recorded or not memory.forgotten)
    found = [episode for episode in known if episode.overlaps(start, end)][::-1]
    told = [_told(episode, store) for episode in found[:limit]]
    return {"alarms": told, "complete": complete and len(found) <= limit}


def _told(episode: Episode, store: Store) -> dict[str, Any]:
    known = next((word for word in reversed(episode.words) if word.kind == "acknowledged"), None)
    said = episode.acknowledged if known is None else Acknowledgement(**_person(known), time=known.time)
    pack = episode.pack or f"{packs.name_of(store.cell, episode.first)}.mcap"  # or named by the alarm
    page = packs.page_of(store.folder / packs.FOLDER / Path(pack).name)
    there = store.recorded and page.exists()
    return {
        **shapes.alarm(episode.alarm, said, f"{packs.FOLDER}/{page.name}" if there else None),
        "active": episode.cleared is None,
        "cleared": ms(episode.cleared),
        "cleared_statement": episode.cleared_statement,
        "people": [_word(word) for word in episode.words],
    }


def _word(word: Event) -> dict[str, Any]:
    until = word.data.get("until")
    told = {"t": ms(word.time), "what": word.kind, **_person(word)}
    return told | ({"until": ms(until)} if isinstance(until, int) else {})


def _person(word: Event) -> dict[str, str]:
    return {key: str(word.data.get(key, "")) for key in ("name", "note")}
