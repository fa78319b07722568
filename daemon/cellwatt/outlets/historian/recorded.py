"""Frames and results that the record of a cell has after a position, in order. Blocks: never on the event loop."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from cellwatt.blocks import cut
from cellwatt.frames import Frames
from cellwatt.outlets.past import files_of, opened
from cellwatt.record.reader import EVER
from cellwatt.results import Alarm, Energy, Task

T = TypeVar("T", Alarm, Task, Energy)


@dataclass(frozen=True, slots=True)
class Position:
    """The last frame that was dealt with: ``session``, its ``sequence`` and its ``time`` UTC ns."""

    session: int
    sequence: int
    time: int


@dataclass(frozen=True, slots=True)
class Place:
    """The last result of a kind that was dealt with: how many of its file, which is ``number`` in ``session``."""

    session: int
    number: int
    count: int


def frames_after(folder: Path, cell: str, position: Position | None) -> Iterator[tuple[int, Frames]]:
    """Blocks of frames after ``position``, each with its session; all there are without one."""
    for kept in files_of(folder, cell):
        session = kept.name.session
        after = position if position is not None and session == position.session else None
        if position is not None and session < position.session:
            continue
        recording = opened(kept.path)
        if recording is None or (after is not None and recording.end <= after.time):
            continue
        for block in (recording if after is None else recording.between(after.time + 1, EVER)).frames():
            known = 0 if after is None else after.sequence + 1 - block.sequence
            if known < len(block):
                yield session, cut(block, known, len(block))


def results_after(folder: Path, cell: str, kind: type[T], place: Place | None) -> Iterator[tuple[Place, T]]:
    """Results of a kind after ``place``, each with its own place."""
    for kept in files_of(folder, cell):
        at = kept.name.session, kept.name.number
        if place is not None and at < (place.session, place.number):
            continue
        recording = opened(kept.path)
        known = place.count if place is not None and at == (place.session, place.number) else 0
        for number, result in enumerate(recording.results(kind) if recording is not None else (), 1):
            if number > known:
                yield Place(*at, number), result
