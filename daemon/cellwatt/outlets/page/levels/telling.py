"""Intervals and alarms of a span out of the record, the alarms from raise to clear, with what people said of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from cellwatt.alarms import RESTARTED, Acknowledgement
from cellwatt.errors import RecordingError, why
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.levels.buckets import span_of
from cellwatt.outlets.page.levels.following import Source
from cellwatt.outlets.page.levels.gathering import Intervals, Said
from cellwatt.outlets.page.levels.store import Store, near
from cellwatt.outlets.page.shapes import mark, ms
from cellwatt.record import packs
from cellwatt.record.folder import RecordFile
from cellwatt.results import Alarm, Event


@dataclass
class Episode:
    """One alarm: its newest ``alarm`` message that was active, times in UTC ns, and what people said of it.

    ``cleared`` is None while it is up; ``raised`` is the time of its ``first`` message.
    """

    alarm: Alarm
    first: Alarm
    session: int
    raised: int
    cleared: int | None = None
    cleared_statement: str | None = None
    words: list[Event] = field(default_factory=list)
    pack: str | None = None
    """File of the evidence, as the daemon told it."""

    def overlaps(self, start: int, end: int) -> bool:
        """True if it was up at some time from ``start`` to before ``end`` UTC ns."""
        return self.raised < end and (self.cleared is None or self.cleared >= start)

    def end(self, time: int, statement: str) -> None:
        """It is over."""
        self.cleared, self.cleared_statement = time, statement


def episodes(told: Iterable[tuple[int, Said]], sessions: Sequence[int]) -> list[Episode]:
    """Alarms by time of raise; ``told`` are sessions (UTC ns of their start) and messages in recorded order.

    ``sessions`` are all that are known: the alarms of one end with the begin of the next.
    """
    found: list[Episode] = []
    up: dict[str, Episode] = {}
    words: list[Event] = []
    for session, said in told:
        for episode in [episode for episode in up.values() if episode.session != session]:
            _end_of_session(episode, sessions)
            del up[episode.alarm.id]
        for alarm in said.alarms:
            _take(alarm, session, up, found)
        words += said.words
    for episode in up.values():
        _end_of_session(episode, sessions)
    _attach(words, found)
    return sorted(found, key=lambda episode: episode.raised)


def _take(alarm: Alarm, session: int, up: dict[str, Episode], found: list[Episode]) -> None:
    episode = up.get(alarm.id)
    if episode is not None and episode.alarm.since != alarm.since and alarm.active:
        episode.end(alarm.since, alarm.statement)  # its clear is lost
        episode = None
    if episode is None:
        episode = Episode(alarm, alarm, session, alarm.time if alarm.active else alarm.since)
        found.append(episode)
    if alarm.active:
        episode.alarm = alarm
        up[alarm.id] = episode
    else:
        episode.end(alarm.time, alarm.statement)
        up.pop(alarm.id, None)


def _end_of_session(episode: Episode, sessions: Sequence[int]) -> None:
    """A daemon that has ended holds no alarm up."""
    later = [session for session in sessions if session > episode.session]
    if episode.cleared is None and later:
        episode.end(max(min(later), episode.alarm.time), RESTARTED)


def _attach(words: Iterable[Event], found: Iterable[Episode]) -> None:
    """Give each event to the alarms that it is about: the last of each id that was raised before."""
    by_id: dict[str, list[Episode]] = {}
    for episode in found:
        by_id.setdefault(episode.alarm.id, []).append(episode)
    for word in words:
        for alarm_id in _ids(word.data):
            before = [episode for episode in by_id.get(alarm_id, ()) if episode.raised <= word.time]
            if not before:
                continue
            if word.kind != "evidence":
                before[-1].words.append(word)
            elif "pack" in word.data:
                start = word.data.get("start", 0)
                inside = (episode for episode in before if episode.raised >= start and episode.pack is None)
                next(inside, before[-1]).pack = str(word.data["pack"])


def _ids(data: Mapping[str, object]) -> list[str]:
    several = data.get("alarms")
    ids = several if isinstance(several, list | tuple) else [data.get("alarm")]
    return [alarm_id for alarm_id in ids if isinstance(alarm_id, str)]


MOST: Final = 2000
"""Intervals, and alarms, that an answer has at most: the longest intervals, the newest alarms."""


def marks(store: Store, recordings: Sequence[RecordFile], start: int, end: int, until: float) -> dict[str, Any]:
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
    alarms = [e for e in joined(recordings, sources) if e.overlaps(start, end)]
    complete = complete and len(rows) <= MOST and len(alarms) <= MOST
    longest = sorted(rows.values(), key=lambda row: row["end"] - row["start"])[-MOST:]
    return {
        "intervals": sorted(longest, key=lambda row: row["start"]),
        "alarms": [mark(e.alarm, e.raised, e.cleared) for e in alarms[-MOST:]],
        "complete": complete,
    }


def read(
    store: Store, recordings: Sequence[RecordFile], start: int, end: int, until: float
) -> tuple[list[tuple[RecordFile, Source]], bool]:
    """Recordings begun before ``end`` with their sources, in order, and true if these are all.

    The newest are read first, until monotonic time ``until``; those written before ``start`` only from level files.
    """
    wanted = {kept.path for kept in near(recordings, start, end)}
    found: list[tuple[RecordFile, Source]] = []
    complete = True
    for kept in reversed(recordings):
        if kept.name.session >= end:
            continue
        try:
            source = store.source(kept, until if kept.path in wanted else 0.0, curves=False)
        except TimeoutError:
            complete = False
            continue
        if source is not None:
            found.append((kept, source))
    return found[::-1], complete


def joined(recordings: Sequence[RecordFile], sources: Sequence[tuple[RecordFile, Source]]) -> list[Episode]:
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


PATIENCE: Final = 10.0
"""s after which an answer is given as far as it goes."""


def alarm_history(
    folder: Path, cell: str, start_ms: float, end_ms: float, limit: int, store: Store | None = None
) -> dict[str, Any]:
    """Alarms that were up from ``start_ms`` to ``end_ms`` UTC ms, at most ``limit``, the newest first, JSON-ready.

    ``evidence_page`` is the path of the page below the route of reports. ``complete`` is false where older ones are
    left out. With a ``store`` of the same folder less is read. Never call it on an event loop.

    Raises ``CellwattError`` for a span that is none, and where the folder cannot be read.
    """
    start, end = span_of(start_ms, end_ms)
    store = store or Store(folder, cell)
    recordings = store.recordings()
    try:
        sources, complete = read(store, recordings, start, end, time.monotonic() + PATIENCE)
    except OSError as error:
        raise RecordingError(f"record.folder {folder} cannot be read: {why(error)}") from error
    found = [episode for episode in joined(recordings, sources) if episode.overlaps(start, end)][::-1]
    pages = {pack.path.name for pack in _packs(folder, cell) if packs.page_of(pack.path).exists()}
    return {
        "alarms": [_told(episode, cell, pages) for episode in found[:limit]],
        "complete": complete and len(found) <= limit,
    }


def _packs(folder: Path, cell: str) -> list[packs.Pack]:
    try:
        return packs.listing(folder / packs.FOLDER, cell)
    except OSError:  # without evidence the alarms are worth telling
        return []


def _told(episode: Episode, cell: str, pages: set[str]) -> dict[str, Any]:
    alarm = episode.alarm
    known = next((word for word in reversed(episode.words) if word.kind == "acknowledged"), None)
    said = None if known is None else Acknowledgement(**_person(known), time=known.time)
    return {
        **shapes.alarm(alarm, said, _page(episode, cell, pages)),
        "active": episode.cleared is None,
        "cleared": shapes.ms(episode.cleared),
        "cleared_statement": episode.cleared_statement,
        "people": [_word(word) for word in episode.words],
    }


def _page(episode: Episode, cell: str, pages: set[str]) -> str | None:
    """Path of the evidence page: that which the daemon told, or that which the alarm itself names."""
    named: Alarm = episode.first
    pack = episode.pack or f"{packs.name_of(cell, named)}.mcap"
    return f"{packs.FOLDER}/{packs.page_of(Path(pack)).name}" if pack in pages else None


def _word(word: Event) -> dict[str, Any]:
    until = word.data.get("until")
    return {
        "t": shapes.ms(word.time),
        "what": word.kind,
        **_person(word),
        **({"until": shapes.ms(until)} if isinstance(until, int) else {}),
    }


def _person(word: Event) -> dict[str, str]:
    return {key: str(word.data.get(key, "")) for key in ("name", "note")}
