"""Alarms of the past, out of the record: when each was raised and cleared, and what people said of it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, Final

from cellwatt.alarms import Acknowledgement
from cellwatt.errors import RecordingError, why
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.levels import Curves
from cellwatt.outlets.page.levels.curves import span_of
from cellwatt.outlets.page.levels.gathering import TELLING
from cellwatt.outlets.page.levels.store import Store
from cellwatt.outlets.page.levels.telling import Episode, read, together
from cellwatt.record import packs
from cellwatt.results import Alarm, Event

PATIENCE: Final = 10.0
"""s after which an answer is given as far as it goes."""


def alarm_history(
    folder: Path, cell: str, start_ms: float, end_ms: float, limit: int, curves: Curves | None = None
) -> dict[str, Any]:
    """Alarms that were up from ``start_ms`` to ``end_ms`` UTC ms, at most ``limit``, the newest first, JSON-ready.

    ``evidence_page`` is the path of the page below the route of reports. ``complete`` is false where older ones are
    left out. With ``curves`` of the same folder less is read. Never call it on an event loop.

    Raises ``CellwattError`` for a span that is none, and where the folder cannot be read.
    """
    start, end = span_of(start_ms, end_ms)
    store = Store(folder, cell, TELLING) if curves is None else curves.store
    recordings = store.recordings()
    try:
        sources, complete = read(store, recordings, start, end, time.monotonic() + PATIENCE)
    except OSError as error:
        raise RecordingError(f"record.folder {folder} cannot be read: {why(error)}") from error
    found = [episode for episode in together(recordings, sources) if episode.overlaps(start, end)][::-1]
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
