"""Where a record that another process left off is gone on with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import pytest

from cellwatt import Alarm, Event
from cellwatt.record.openfile import OpenFile
from cellwatt.record.survey import survey
from cellwatt.runtime.processes.resume import Resume
from tests.daemon.record.making import CELL, METER, SESSION, batch_of, frames_of, name_of, write_chunks


def resume(folder: Path) -> Resume:
    return Resume._read(folder, CELL, SESSION, ())


def written(folder: Path) -> OpenFile:
    return write_chunks(folder, [[batch_of(0, 5), frames_of(0, 4)], [batch_of(5, 5)], [batch_of(10, 5)]])


def test_it_goes_on_behind_the_last_of_each_stream(tmp_path: Path) -> None:
    written(tmp_path)
    found = resume(tmp_path)
    assert found.following == {"/raw/arm/rtde": 15, "/frame": 4}
    assert found.fresh(batch_of(10, 5)) is None
    rest = found.fresh(batch_of(13, 5))
    assert rest is not None
    assert (rest.sequence, len(rest)) == (15, 3)


def test_a_slow_stream_goes_on_behind_its_last_sample(tmp_path: Path) -> None:
    """An arm with 500 samples a second in chunks of 40 ms, and a meter with a sample each second."""
    raised = Alarm("a", "heat", "warning", True, SESSION, SESSION, "Joint 2 is hot.")
    first = [batch_of(0, 1, stream=METER, source="supply"), raised, batch_of(0, 20)]
    write_chunks(tmp_path, [first, *([batch_of(20 * n, 20)] for n in range(1, 25))])
    found = resume(tmp_path)
    assert found.following == {"/raw/supply/meter": 1, "/raw/arm/rtde": 500}
    assert not found.lacks(raised)


def test_weeks_of_files_are_not_searched_for_an_item_of_long_ago(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    weeks = 21 * 86_400 * 10**9
    old, new = (Event(SESSION + after, "arm", "connected", "UR10e") for after in (0, weeks))
    later = batch_of(5, 5)
    write_chunks(tmp_path, [[batch_of(0, 5), old]], number=1)
    for number in (2, 3):
        write_chunks(tmp_path, [[replace(later, time=later.time + weeks)]], number=number)
    opened = Mock(side_effect=survey)
    monkeypatch.setattr("cellwatt.runtime.processes.resume.survey", opened)
    found = Resume._read(tmp_path, CELL, SESSION, {"event"})
    assert [call.args[0].name for call in opened.call_args_list] == [name_of(2), name_of(3)]
    assert found.unrecorded([(0, old), (1, new)]) == [(1, new)]


@pytest.mark.parametrize("offset", [60, 200])
def test_what_a_damaged_chunk_held_is_recorded_again(tmp_path: Path, offset: int) -> None:
    file = written(tmp_path)
    data = bytearray(file.path.read_bytes())
    last = file.contents.chunks[-1]
    data[last.offset + offset] ^= 0xFF
    file.path.write_bytes(data)
    assert resume(tmp_path).following["/raw/arm/rtde"] == 10
