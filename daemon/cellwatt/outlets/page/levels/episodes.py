"""Intervals and alarms of a span out of the record, the alarms from raise to clear, with what people said of them."""

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
"""Intervals, and alarms, that an answer has at most: the longest intervals, the newest alarms."""
PATIENCE: Final = 10.0
"""s after which an answer is given as far as it goes."""

Found = Mapping[FileName, tuple[Sequence[Alarm | Event], Sequence[Span]]]
"""What was said in recordings, and intervals there."""


@dataclass
class Episode:
    """One alarm: its ``first`` message, the newest that was active, times in UTC ns, and what people said of it.

    ``cleared`` is None while it is up.
    """

    first: Alarm
    alarm: Alarm
    raised: int
    cleared: int | None = None
    cleared_statement: str | None = None
    acknowledged: Acknowledgement | None = None
    words: list[Event] = field(default_factory=list)
    pack: str | None = None
    """File of the evidence, as the daemon told it."""

    def overlaps(self, start: int, end: int) -> bool:
        """True if it was up at some time from ``start`` to before ``end`` UTC ns."""
        return self.raised < end and (self.cleared is None or self.cleared >= start)

    def is_part_of(self, other: Episode) -> bool:
        """True if it is of the same alarm as one that memory has whole."""
        return self.first.id == other.first.id and self.overlaps(
            other.raised, EVER if other.cleared is None else other.cleared + 1
        )

    def end(self, time: int, statement: str) -> None:
        """It is over, if it was not before."""
        if self.cleared is None:
            self.cleared, self.cleared_statement = time, statement


@dataclass(frozen=True)
class Memory:
    """The end of the present, which may not be recorded yet.

    ``step`` of the frames, ns; samples by channel, intervals (UTC ns), alarms, and how many older ones were forgotten.
    """

    step: int = 0
    samples: Mapping[str, Samples] = field(default_factory=dict)
    spans: Sequence[Span] = ()
    alarms: Sequence[Episode] = ()
    forgotten: int = 0


def episodes(recordings: Sequence[RecordFile], found: Found) -> list[Episode]:
    """Alarms by time of raise, of what was said in order; those of a session end with the begin of the next."""
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
    """Take a message of an alarm: it begins, goes on, or is over."""
    up = known[-1] if known and known[-1].cleared is None else None
    if up is not None and up.alarm.since != alarm.since and alarm.active:
        up.end(alarm.since, alarm.statement)  # its clear is lost
        up = None
    if up is None:
        up = Episode(alarm, alarm, alarm.time if alarm.active else alarm.since)
        known.append(up)
    if alarm.active:
        up.alarm = alarm
    else:
        up.end(alarm.time, alarm.statement)


def _note(event: Event, known: Mapping[str, Sequence[Episode]]) -> None:
    """Give an event to the alarms that it is about: the last of each id, of evidence the first that has none yet."""
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
    """Intervals and alarms from ``start`` to before ``end`` UTC ns, as far as ``pace`` lets them be read.

    Recordings of long before are asked only if they have a level file: an alarm that is still up may stand there.
    """
    rows = {(span.source, span.number, span.start): span for span in memory.spans if span.overlaps(start, end)}
    found, complete = read(store, recordings, start, end, pace, intervals=True)
    for name in sorted(found):  # of an interval that ran on into the next recording that has the last of it
        spans = (span for span in found[name][1] if span.overlaps(start, end))
        rows |= {(span.source, span.number, span.start): span for span in spans}
    held = [episode for episode in memory.alarms if episode.overlaps(start, end)]
    # Memory knows since when, the record when it was told, and by its stage: there it may come and go meanwhile.
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
    """Recordings begun before ``end``, with intervals if they are asked for, and true if these are all.

    The newest are read first, until ``pace`` raises ``TimeoutError``; those of before ``start`` only from level files.
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
    """Alarms that were up from ``start_ms`` to ``end_ms`` UTC ms, at most ``limit``, the newest first, JSON-ready.

    Without a record they are those of ``memory``. ``evidence_page`` is the path of the page below the route of reports.
    ``complete`` is false where older ones are left out. Never call it on an event loop.

    Raises ``RecordingError`` where the folder cannot be read.
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
    pack = episode.pack or f"{packs.name_of(store.cell, episode.first)}.mcap"  # where the alarm itself names it
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
