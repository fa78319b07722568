"""Which recordings of a cell hold data of a span of time, also while one is being written."""

from __future__ import annotations

from functools import lru_cache
from itertools import groupby
from pathlib import Path
from typing import Final

from cellwatt.errors import RecordingError
from cellwatt.record.folder import RecordFile, files_of
from cellwatt.record.survey import survey

DELAY: Final = 300 * 10**9
"""Longest time, ns, from the end of what a result is about until the result is recorded."""


def recordings_between(folder: Path, cell: str, start: int, end: int) -> list[RecordFile]:
    """Recordings that may hold data from ``start`` to ``end``, UTC ns, in the order in which they were recorded.

    They include unreadable ones, and the one being written if it may have begun before ``end``. The files of a session
    are in the order of their times; between two sessions, the PC's clock may have been set back.
    """
    found: list[RecordFile] = []
    for session, group in groupby(files_of(folder, cell), key=lambda file: file.name.session):
        files = [*group]
        within = list[RecordFile]()
        for file, before in reversed([*zip(files, [None, *files], strict=False)]):
            if not file.closed:  # all of it would be scanned to find its start
                if session <= end and (before is None or not before.closed or reach(before)[1] <= end + DELAY):
                    within.append(file)
                continue
            first, last = reach(file)
            if 0 < last < start:
                break
            if first <= end:
                within.append(file)
        found += reversed(within)
    return found


def reach(file: RecordFile) -> tuple[int, int]:
    """Start and end of a recording, UTC ns; 0 if nothing in it can be read now."""
    try:
        return _reach(file)
    except (RecordingError, FileNotFoundError):
        return 0, 0


@lru_cache(maxsize=16_384)  # weeks of files are looked through for each part of a back-fill
def _reach(file: RecordFile) -> tuple[int, int]:
    contents = survey(file.path, chunks=False).contents
    return contents.start, contents.end
