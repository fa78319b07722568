"""Rows out of the record, against rows made of the same frames at once."""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt.outlets import past
from cellwatt.outlets.past import read
from cellwatt.outlets.selection import Picker, Selection
from cellwatt.record import overlap
from cellwatt.record.survey import Survey, survey
from cellwatt.results import Alarm
from tests.daemon.outlets.page.recorded import CELL, Written, frames, recording

STEP = 20_000_000
SELECTION = Selection(rate=10.0)
SPAN = 100_000_000


@pytest.fixture
def start() -> int:
    """A minute ago, where a span begins."""
    return (time.time_ns() - 60 * 10**9) // SPAN * SPAN


def block(start: int, first: int, count: int, names: tuple[str, ...] = ("arm.power",)):
    numbers = np.arange(first, first + count)
    return frames(start + numbers * STEP, np.repeat(numbers[:, None], len(names), axis=1), names)


def rows_of(*blocks):
    picker = Picker(SELECTION, blocks[0].layout)
    return [r for b in blocks for r in picker.rows(b)] + list(picker.rest())


def keys(rows):
    return [(r.time, dict(r.values)) for r in rows]


def test_rows_of_several_files_and_sessions_are_those_of_the_frames(tmp_path: Path, start: int) -> None:
    blocks = [block(start, i, 33) for i in range(1, 331, 33)]
    for number, several in enumerate((blocks[:4], blocks[4:7]), 1):
        recording(tmp_path, [several], number, session=start - 10)
    open_ = Written(tmp_path, 1, session=start - 5).chunk(*blocks[7:])
    recording(tmp_path, [[block(start, 0, 400)]], cell="another")
    wanted = [r for r in rows_of(*blocks) if start + SPAN < r.time <= start + 50 * SPAN]
    part = read(tmp_path, CELL, SELECTION, start + SPAN, start + 50 * SPAN, 1000)
    assert part.whole and keys(part.rows) == keys(wanted)
    found, after = [], start + SPAN
    while not (part := read(tmp_path, CELL, SELECTION, after, start + 50 * SPAN, 7)).whole:
        assert len(part.rows) == 7
        found += part.rows
        after = part.rows[-1].time
    assert keys(found + part.rows) == keys(wanted)
    open_.crash()


def test_a_span_that_the_record_has_not_reached_is_waited_for(tmp_path: Path) -> None:
    now = time.time_ns() // SPAN * SPAN
    written = Written(tmp_path, session=now - 1).chunk(block(now, 1, 12))
    part = read(tmp_path, CELL, SELECTION, now, now + 5 * SPAN, 100)
    assert part.waits and not part.whole
    assert [r.time for r in part.rows] == [now + SPAN, now + 2 * SPAN], "whole rows come meanwhile"
    written.chunk(block(now, 13, 13))
    part = read(tmp_path, CELL, SELECTION, now + 2 * SPAN, now + 5 * SPAN, 100)
    assert part.whole and [r.time for r in part.rows] == [now + n * SPAN for n in (3, 4, 5)]
    written.crash()


def test_what_never_came_is_not_waited_for(tmp_path: Path, start: int, monkeypatch: pytest.MonkeyPatch) -> None:
    recording(tmp_path, [[block(start, 1, 12)]], session=start - 1)
    part = read(tmp_path, CELL, SELECTION, start, start + 10 * SPAN, 100)
    assert part.whole and [r.time for r in part.rows] == [start + n * SPAN for n in (1, 2, 3)]
    assert part.rows[-1].values == {"arm.power": 11.5}
    monkeypatch.setattr(past, "PATIENCE", 3600 * 10**9)
    assert read(tmp_path, CELL, SELECTION, start, start + 10 * SPAN, 100).waits


def test_other_channels_make_other_rows(tmp_path: Path, start: int) -> None:
    blocks = [block(start, 1, 7), block(start, 8, 20, ("arm.power", "meter.power"))]
    for number, b in enumerate(blocks, 1):
        recording(tmp_path, [[b]], number, session=start - 1)
    part = read(tmp_path, CELL, SELECTION, start, start + 4 * SPAN, 100)
    assert part.whole
    assert [list(r.values) for r in part.rows][:2] == [["arm.power"], ["arm.power"]]
    assert all(list(r.values) == ["arm.power", "meter.power"] for r in part.rows[2:])
    assert all(a.time <= b.time for a, b in pairwise(part.rows))


def test_what_was_recorded_before_the_clock_was_set_back_is_found(tmp_path: Path, start: int) -> None:
    """The later session begins, by its clock, three hours before the end of the one before."""
    hours = 3 * 3600 * 10**9
    recording(tmp_path, [[block(start - 2 * hours, 1, 30)]], 1, session=start - 2 * hours)
    recording(tmp_path, [[block(start, 1, 30)]], 2, session=start - 2 * hours)
    recording(tmp_path, [[block(start - hours, 1, 30)]], 1, session=start - hours)
    part = read(tmp_path, CELL, SELECTION, start, start + 4 * SPAN, 100)
    assert part.whole and [r.time for r in part.rows] == [start + n * SPAN for n in (1, 2, 3, 4)]


def test_what_is_damaged_or_gone_is_left_out(tmp_path: Path, start: int) -> None:
    recording(tmp_path, [[block(start, 1, 10)]], 1, session=start - 1)
    broken = recording(tmp_path, [[block(start, 11, 10)]], 2, session=start - 1)
    recording(tmp_path, [[block(start, 21, 30)]], 3, session=start - 1)
    broken.write_bytes(b"nothing that is a recording")
    part = read(tmp_path, CELL, SELECTION, start, start + 6 * SPAN, 100)
    assert part.whole and [r.time for r in part.rows] == [start + n * SPAN for n in (1, 2, 5, 6)]
    assert read(tmp_path / "none", CELL, SELECTION, start, start + SPAN, 9).whole


def test_what_the_repair_of_a_recording_set_aside_is_not_sent_again(tmp_path: Path, start: int) -> None:
    found = Alarm("a", "k", "warning", True, start, start + SPAN // 2, "It is so.")
    whole = recording(tmp_path, [[block(start, 1, 30), found]], session=start - 1)
    shutil.copy(whole, whole.with_name(f"{whole.name}.damaged"))
    part = read(tmp_path, CELL, SELECTION, start, start + 2 * SPAN, 100, results=True)
    assert part.results == [found] and len(part.rows) == 2


def test_one_that_is_being_written_and_cannot_be_read_is_not_taken_for_empty(tmp_path: Path, start: int) -> None:
    whole = recording(tmp_path, [[block(start, 1, 10)]], 1, session=start - 1)
    part = whole.rename(whole.with_name(f"{whole.name}.part"))
    content = part.read_bytes()
    part.write_bytes(content[:3])
    with pytest.raises(RecordingError, match="cannot be read yet"):
        read(tmp_path, CELL, SELECTION, start, start + 2 * SPAN, 9)
    os.utime(part, (start / 1e9 - 60, start / 1e9 - 60))
    assert read(tmp_path, CELL, SELECTION, start, start + 2 * SPAN, 9).whole, "nobody writes it any more"
    part.write_bytes(content)
    assert len(read(tmp_path, CELL, SELECTION, start, start + 2 * SPAN, 9).rows) == 2


def test_recordings_that_do_not_belong_to_the_span_are_opened_once_at_most(
    tmp_path: Path, start: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A back-fill after days reads small parts, each of which lies in one of many recordings."""
    for number in range(1, 9):
        recording(tmp_path, [[block(start + (number - 1) * 600 * 10**9, 300, 300)]], number, session=start - 1)
    live = Written(tmp_path, 9, session=start - 1).chunk(block(start + 4800 * 10**9, 300, 50))
    looked: list[str] = []

    def noted(path: Path, **how: bool) -> Survey:
        looked.append(path.name)
        return survey(path, **how)

    for module in (past, overlap):
        monkeypatch.setattr(module, "survey", noted)
    after, until, reads = start + 60 * SPAN, start + 90 * SPAN, 0
    while not (part := read(tmp_path, CELL, SELECTION, after, until, 5)).whole:
        assert len(part.rows) == 5
        after, reads = part.until, reads + 1
    assert reads > 5 and not any(name.endswith(".part") for name in looked)
    assert all(times == 1 for name, times in Counter(looked).items() if "_000001" not in name)
    live.crash()


def test_a_recording_that_has_just_begun_hides_none_of_those_before(tmp_path: Path, start: int) -> None:
    recording(tmp_path, [[block(start, 1, 30)]], 1, session=start - 1)
    live = Written(tmp_path, 2, session=start - 1)
    part = read(tmp_path, CELL, SELECTION, start, start + 4 * SPAN, 100)
    assert [row.time for row in part.rows] == [start + n * SPAN for n in (1, 2, 3, 4)]
    live.crash()


def test_a_recording_that_could_not_be_opened_once_is_read_later(
    tmp_path: Path, start: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording(tmp_path, [[block(start, 1, 30)]], session=start - 1)
    with monkeypatch.context() as patched:
        for module in (past, overlap):
            patched.setattr(module, "survey", Mock(side_effect=RecordingError("Too many open files")))
        assert read(tmp_path, CELL, SELECTION, start, start + 4 * SPAN, 100).rows == []
    assert len(read(tmp_path, CELL, SELECTION, start, start + 4 * SPAN, 100).rows) == 4
