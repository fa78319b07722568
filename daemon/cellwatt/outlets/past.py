"""Rows and results of the past, out of the record. Blocks: never call it on an event loop."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from cellwatt.errors import RecordingError
from cellwatt.frames import cut
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.record import Recording
from cellwatt.record.folder import listing
from cellwatt.record.survey import survey
from cellwatt.results import Alarm, Energy, Task

ARCHIVED: Final = {"alarms": Alarm, "tasks": Task, "energies": Energy}
"""Results that are filled in, by table."""
Archived = Alarm | Task | Energy
LATE: Final = 3600 * 10**9
"""ns by which the clock of a cell may have been set back between two recordings."""
BEYOND: Final = 2_000_000_000
"""ns after a span in which a frame tells that the span is in the record as far as it ever will be."""
PATIENCE: Final = 30_000_000_000
"""ns after which a span that has not come to its end in the record never will."""
WRITTEN: Final = 60.0
"""s since the last change of an open recording in which it may be that it cannot be read just now."""


@dataclass(slots=True)
class RecordedSpan:
    """What the record has of a span up to ``until``, in order, its rows in ``units``.

    ``whole``: there is no more; ``waits``: the record has not got as far yet.
    """

    until: int
    rows: list[Row] = field(default_factory=list)
    results: list[Archived] = field(default_factory=list)
    units: Mapping[str, str] = field(default_factory=dict)
    whole: bool = False
    waits: bool = False


def read(
    folder: Path, cell: str, selection: Selection, after: int, until: int, most: int, *, results: bool = False
) -> RecordedSpan:
    """Rows after ``after`` up to ``until`` UTC ns, the first ``most`` of them, and the results up to the last.

    Raises ``OSError`` where the folder cannot be read, and ``RecordingError`` where that is so of the recording that is
    being written; what else is damaged in it, or gone, is left out.
    """
    recordings = list(_recordings(folder, cell, after, until))[::-1]
    part = _rows(recordings, selection, after, until, most)
    for recording in recordings if results and part.until > after else ():
        for kind in ARCHIVED.values():
            part.results += recording.between(after + 1, part.until).results(kind)
    return part


def _rows(recordings: list[Recording], selection: Selection, after: int, until: int, most: int) -> RecordedSpan:
    part, picker, last = RecordedSpan(after), None, after
    for frames in (f for r in recordings for f in r.between(after + 1, until + BEYOND).frames()):
        inside = int(np.searchsorted(frames.time, until, side="right"))
        if picker is None or picker.layout != frames.layout:
            part.rows += [] if picker is None else picker.rest()
            picker = Picker(selection, frames.layout)
            part.units = picker.units
        if inside and frames.time[0] > last:
            part.rows += picker.rows(cut(frames, 0, inside) if inside < len(frames) else frames)
            last = int(frames.time[inside - 1])
        if len(part.rows) >= most:
            del part.rows[most:]
            part.until = part.rows[-1].time
            return part
        if inside < len(frames) or last + frames.layout.step > until:
            part.whole = True
            break
    if not part.whole:
        part.whole = time.time_ns() > until + PATIENCE
        part.waits = not part.whole
    if part.whole and picker is not None:
        # Rows of another rate, before a reload, may end beyond the span.
        part.rows += (row for row in picker.rest() if row.time <= until)
    part.until = until if part.whole else part.rows[-1].time if part.rows else after
    return part


def _recordings(folder: Path, cell: str, after: int, until: int) -> Iterator[Recording]:
    """Recordings in which there may be something of the span, the newest first."""
    for kept in reversed(listing(folder, cell)):
        if kept.name.session > until:
            continue
        recording = opened(kept.path)
        if recording is None and not kept.closed and time.time() - kept.modified < WRITTEN:
            raise RecordingError(f"{kept.path} is being written, and cannot be read yet")
        if recording is not None and recording.start <= until + BEYOND and recording.end > after:
            yield recording
        if recording is not None and recording.start <= after - LATE:
            return


def opened(path: Path) -> Recording | None:
    """A recording as far as it is on disk; ``None`` where nothing can be read of it, or it is gone by now."""
    try:
        return Recording([survey(path, chunks=False)])
    except (RecordingError, FileNotFoundError):
        return None
