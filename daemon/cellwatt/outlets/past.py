"""Past rows and results, read from the record. Blocks: never call it on an event loop."""

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
from cellwatt.record.overlap import recordings_between
from cellwatt.record.survey import survey
from cellwatt.results import Alarm, Energy, Task

ARCHIVED: Final = {"alarms": Alarm, "tasks": Task, "energies": Energy}
"""Types of the results that are back-filled, by table."""
Archived = Alarm | Task | Energy
BEYOND: Final = 2_000_000_000
"""A frame within this time, ns, after a span shows that the record of the span is complete."""
PATIENCE: Final = 30_000_000_000
"""Time after the end of a span, ns, from which the record of the span counts as complete."""
WRITTEN: Final = 60.0
"""Time since the last change of an open recording, s, within which it may be unreadable for a moment."""


@dataclass(slots=True)
class RecordedSpan:
    """Content of the record from a span up to ``until``, in order, the rows in ``units``.

    ``whole``: the span is complete; ``waits``: the record does not reach its end yet.
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
    """The first ``most`` rows after ``after`` up to ``until``, UTC ns, and the results up to the last row.

    Raises ``OSError`` if the folder cannot be read, ``RecordingError`` if the recording being written cannot be read;
    other damaged or deleted recordings are skipped.
    """
    recordings = list(_recordings(folder, cell, after, until))
    span = _rows(recordings, selection, after, until, most)
    for recording in recordings if results and span.until > after else ():
        for kind in ARCHIVED.values():
            span.results += recording.between(after + 1, span.until).results(kind)
    return span


def _rows(recordings: list[Recording], selection: Selection, after: int, until: int, most: int) -> RecordedSpan:
    span, picker, last = RecordedSpan(after), Picker(selection), after
    for frames in (f for r in recordings for f in r.between(after + 1, until + BEYOND).frames()):
        inside = int(np.searchsorted(frames.time, until, side="right"))
        if inside and frames.time[0] > last:
            span.rows += picker.rows(cut(frames, 0, inside) if inside < len(frames) else frames)
            span.units, last = picker.units, int(frames.time[inside - 1])
        if len(span.rows) >= most:
            del span.rows[most:]
            span.until = span.rows[-1].time
            return span
        if inside < len(frames) or last + frames.layout.step > until:
            span.whole = True
            break
    if not span.whole:
        span.whole = time.time_ns() > until + PATIENCE
        span.waits = not span.whole
    if span.whole:
        # Rows of another rate, before a reload, may end beyond the span.
        span.rows += (row for row in picker.rest() if row.time <= until)
    span.until = until if span.whole else span.rows[-1].time if span.rows else after
    return span


def _recordings(folder: Path, cell: str, after: int, until: int) -> Iterator[Recording]:
    """Recordings that may overlap the span, in the order in which they were recorded."""
    for file in recordings_between(folder, cell, after + 1, until + BEYOND):
        recording = opened(file.path)
        if recording is not None:
            yield recording
        elif not file.closed and time.time() - file.modified < WRITTEN:
            raise RecordingError(f"{file.path} is being written, and cannot be read yet")


def opened(path: Path) -> Recording | None:
    """A recording as far as it is on disk; ``None`` if nothing in it can be read or the file no longer exists."""
    try:
        return Recording([survey(path, chunks=False)])
    except (RecordingError, FileNotFoundError):
        return None
