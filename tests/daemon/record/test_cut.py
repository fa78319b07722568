"""A span of time cut out of the record into one file."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from cellwatt import Alarm, Event, RecordingError, Tick
from cellwatt.record import Recording
from cellwatt.record.cut import cut
from tests.daemon.record.making import CELL, HEADER, PERIOD, SESSION, batch_of, frames_of, stream_of, write_chunks

HALF = 500_000_000  # ns; 250 samples


def alarm_at(time: int) -> Alarm:
    return Alarm("faults.arm.joint_fault.2", "joint_fault", "error", True, time, time, "Joint 2 needs 38 W more")


def write_record(folder: Path) -> None:
    """Three files of 1 s, 500 samples: samples, frames, and an alarm at 1.5 s."""
    for number in range(3):
        chunks = [
            [batch_of(first, 50), frames_of(first // 10, 5), Tick(SESSION + (first + 49) * PERIOD)]
            for first in range(500 * number, 500 * (number + 1), 50)
        ]
        if number == 1:
            chunks[5].append(alarm_at(SESSION + 750 * PERIOD))
        write_chunks(folder, chunks, number=number + 1, close=number < 2)


def test_the_span_and_nothing_else_over_several_files_one_still_open(tmp_path):
    write_record(tmp_path)
    start, end = SESSION + 300 * PERIOD, SESSION + 1200 * PERIOD
    made = cut(tmp_path, CELL, start, end, tmp_path / "evidence" / "pack.mcap")
    assert (made.start, made.end) == (start, end) and not made.lost
    assert [p.name for p in made.sources] == sorted(p.name for p in tmp_path.glob("*.mcap*"))
    pack = Recording.open(made.path)
    samples = pack.batches("arm", "rtde")
    assert samples.sequence.tolist() == list(range(300, 1201))
    truth = batch_of(300, 901)
    assert samples.values.tobytes() == truth.values.tobytes() and samples.bound.tolist() == truth.bound.tolist()
    assert pack.frames_table().sequence == 30 and len(pack.frames_table()) == 91
    assert pack.alarms() == [alarm_at(SESSION + 750 * PERIOD)]
    assert pack.header.session == SESSION and pack.header.settings == "site: plant-1\n" and pack.header.number == 0
    assert made.size == made.path.stat().st_size and made.messages == sum(pack.counts.values())


def test_a_restart_of_the_daemon_and_new_channels_within_the_span(tmp_path):
    """Numbers of samples begin anew with a session, and channels change with new settings."""
    write_chunks(tmp_path, [[batch_of(1000, 100)]], number=1)
    wider = stream_of(7)
    write_chunks(tmp_path, [[batch_of(1100, 100, stream=wider)]], number=2)
    later = SESSION + 10**10
    again = [batch_of(0, 100, stream=wider), Event(SESSION + 5 * 10**9, None, "begun", "again")]
    write_chunks(tmp_path, [again], header=replace(HEADER, session=later))
    made = cut(tmp_path, CELL, SESSION, SESSION + 6 * 10**9, tmp_path / "out" / "pack.mcap")
    batches = [b for b in Recording.open(made.path).entries() if not isinstance(b, Tick)]
    assert [(b.sequence, len(b.stream.channels)) for b in batches] == [(1000, 6), (1100, 7), (0, 7)]
    assert Recording.open(made.path).header.session == later


def test_others_files_in_the_folder_are_left_out(tmp_path):
    write_record(tmp_path)
    write_chunks(tmp_path, [[batch_of(0, 100, source="other")]], header=replace(HEADER, cell="paint-1"))
    (tmp_path / "notes.mcap").write_bytes(b"not ours")
    made = cut(tmp_path, CELL, SESSION, SESSION + HALF, tmp_path / "out" / "pack.mcap")
    assert Recording.open(made.path).sources == ("arm",)


def test_a_span_without_anything_is_said_and_leaves_no_file(tmp_path):
    write_record(tmp_path)
    with pytest.raises(RecordingError, match=r"nothing of cell weld-3 was recorded from 2026-11-2\d "):
        cut(tmp_path, CELL, SESSION - 10**9, SESSION - 1, tmp_path / "out" / "pack.mcap")
    assert not list(tmp_path.glob("out/*"))


def test_of_months_only_the_files_of_the_span_are_opened(tmp_path, monkeypatch):
    for number in range(12):
        write_chunks(tmp_path, [[batch_of(50 * number, 50)]], number=number + 1)
    opened = Mock(side_effect=Recording.open)
    monkeypatch.setattr(Recording, "open", opened)
    made = cut(tmp_path, CELL, SESSION + 450 * PERIOD, SESSION + 520 * PERIOD, tmp_path / "out" / "pack.mcap")
    assert sorted(made.sources) == sorted(opened.call_args.args[0]) == sorted(tmp_path.glob("*.mcap"))[9:11]
    assert made.messages == 71


def test_a_file_removed_meanwhile_is_told(tmp_path, monkeypatch):
    write_record(tmp_path)
    items = Recording.items

    def after_removal(self):
        sorted(tmp_path.glob("*.mcap"))[1].unlink()
        return items(self)

    monkeypatch.setattr(Recording, "items", after_removal)
    made = cut(tmp_path, CELL, SESSION, SESSION + 1499 * PERIOD, tmp_path / "out" / "pack.mcap")
    (lost,) = made.lost
    assert "was removed while the recording was read" in lost
    sequence = Recording.open(made.path).batches("arm", "rtde").sequence
    assert [(a, b) for a, b in pairwise(sequence.tolist()) if b - a > 1] == [(499, 1000)]
    assert np.all(np.diff(sequence) > 0)
