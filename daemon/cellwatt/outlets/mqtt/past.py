"""Rows of the past, out of the record."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from cellwatt.blocks import cut
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.record import Recording
from cellwatt.record.opening import survey
from cellwatt.record.retention import Kept, listing

LATE: Final = 3600.0
"""s by which the clocks of a cell and of its disk may differ."""
BEYOND: Final = 2_000_000_000
"""ns after a span in which a frame tells that the span is in the record as far as it ever will be."""
PATIENCE: Final = 30_000_000_000
"""ns after which a span that has not come to its end in the record never will."""


@dataclass(slots=True)
class Part:
    """Rows of a span, in order. ``whole``: there are no more; ``waits``: the record has not got as far yet."""

    rows: list[Row] = field(default_factory=list)
    whole: bool = False
    waits: bool = False


def read(folder: Path, cell: str, selection: Selection, after: int, until: int, most: int) -> Part:
    """Rows after ``after`` up to ``until`` UTC ns, the first ``most`` of them. Never call it on an event loop.

    Raises ``OSError`` where the folder cannot be read; what is damaged in it, or gone, is left out.
    """
    part, picker, last = Part(), None, after
    for frames in _frames(_files(folder, cell, after, until), after + 1, until + BEYOND):
        inside = int(np.searchsorted(frames.time, until, side="right"))
        if picker is None or picker.layout != frames.layout:
            part.rows += [] if picker is None else picker.rest()
            picker = Picker(selection, frames.layout)
        if inside and frames.time[0] > last:
            part.rows += picker.rows(cut(frames, 0, inside) if inside < len(frames) else frames)
            last = int(frames.time[inside - 1])
        if len(part.rows) >= most:
            del part.rows[most:]
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
    return part


def _files(folder: Path, cell: str, after: int, until: int) -> list[Kept]:
    """Recordings in which there may be frames of the span, in order."""
    first = after / 1e9 - LATE
    return [kept for kept in listing(folder, cell) if kept.modified >= first and kept.name.session <= until]


def _frames(files: list[Kept], start: int, end: int) -> Iterator[Frames]:
    for kept in files:
        try:
            recording = Recording((survey(kept.path, chunks=False),))
            if recording.start <= end and recording.end >= start:
                yield from recording.between(start, end).frames()
        except (RecordingError, FileNotFoundError):
            continue
