"""What a file of a recording says of itself: its state, its span, and where each topic begins in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from cellwatt.errors import RecordingError
from cellwatt.files import open_file
from cellwatt.record import seal
from cellwatt.record.container import Contents
from cellwatt.record.decoder import Track, tracks_of
from cellwatt.record.opening import survey
from cellwatt.record.retention import Kept
from cellwatt.record.summary import Survey, read_summary


@dataclass(frozen=True, slots=True)
class Known:
    """Index of a file: ``firsts`` maps topics and series to their channel and first sequence number."""

    kept: Kept
    state: str
    start: int
    end: int
    messages: int
    firsts: Mapping[str, tuple[int, int]]
    seal: Mapping[str, Any] | None = None
    """Signature of the cell for it, see ``record.seal``."""


def tracks_in(contents: Contents) -> dict[int, Track]:
    """Readers of the channels; another thread may define more meanwhile."""
    return tracks_of(dict(contents.channels))[0]


def look_at(kept: Kept) -> Known:
    """Read what a file says of itself; one that its writer left open waits for its repair."""
    nothing = Known(kept, "unreadable", 0, 0, 0, {})
    try:
        if kept.path.suffix == ".mcap":
            found: Survey = survey(kept.path, chunks=False)
            known = known_as(kept, found.contents, "closed" if not found.damage and found.closed else "damaged")
            return replace(known, seal=seal.read(kept.path))
        if not kept.closed:
            with open_file(kept.path) as file:
                summary = read_summary(file, chunks=False)
            return known_as(kept, summary, "closing") if summary else Known(kept, "left open", 0, 0, 0, {})
    except (OSError, ValueError, RecordingError):
        pass
    return nothing


def known_as(kept: Kept, contents: Contents, state: str) -> Known:
    """The index of a file from its contents."""
    firsts = {t.series: (number, t.first) for number, t in tracks_in(contents).items() if t.series is not None}
    return Known(kept, state, contents.start, contents.end, sum(dict(contents.counts).values()), firsts)
