import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.faults import recordings
from cellwatt_plugins.faults.recordings import APART, frames_of_files, frames_of_table
from tests.daemon.logs.making import JOINTS, POSITION, TIME, bag, store, usual
from tests.plugins.faults.watching import write_recording


def columns():
    t = np.arange(500) / 100
    return t, np.column_stack([np.sin(t + 1), np.sin(t + 2)]), 90 + t


def written(path, stretch=1.0):
    t, position, power = columns()
    return write_recording(path, t * stretch, position, power)


def test_holes_are_missing():
    t, position, power = columns()
    keep = (t < 2.0) | (t >= 2.5)
    frames = frames_of_table(t[keep], position[keep], power[keep])
    assert len(frames) == 500
    assert np.isnan(frames.values[205:245]).all()
    assert not np.isnan(frames.values[:199]).any()
    assert not np.isnan(frames.values[251:]).any()
    assert (frames.quality[np.isnan(frames.values)] == 4).all()


def test_files_follow_each_other_apart(tmp_path):
    blocks = list(frames_of_files([written(tmp_path / name) for name in ("a.csv", "b.parquet")]))
    assert [len(b) for b in blocks] == [500, 500]
    assert blocks[0].layout == blocks[1].layout
    assert blocks[1].time[0] - blocks[0].time[-1] >= APART
    assert blocks[1].values == pytest.approx(blocks[0].values)


def test_tables_with_time_stamps_that_jitter_have_one_rate(tmp_path):
    one, other = frames_of_files([written(tmp_path / "a.csv"), written(tmp_path / "b.csv", 1.002)])
    assert one.layout == other.layout
    assert (len(one), len(other)) == (500, 500)
    assert not np.isnan(other.values).any()


def test_a_meter_beside_a_recording_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"meter.csv: a meter's table goes with a table"):
        list(frames_of_files([tmp_path / "today.mcap"], [tmp_path / "meter.csv"]))


def test_a_bag_is_a_table_and_may_have_a_meter(tmp_path, monkeypatch):
    types = store()
    path = bag(tmp_path / "bag", usual(types, JOINTS[::-1]), types)
    with pytest.raises(RecordingError, match="no column power"):
        list(frames_of_files([path], joints=JOINTS))
    monkeypatch.setattr(recordings, "power_beside", lambda _, time, __: 90 + time)
    (frames,) = frames_of_files([path], [tmp_path / "meter.csv"], JOINTS)
    position = np.column_stack([np.interp(frames.time * 1e-9, TIME, column) for column in POSITION.T])
    assert frames.values[1:-1, :-1] == pytest.approx(position[1:-1], abs=1e-3)


@pytest.mark.parametrize("seconds", [50_000.0, 1e9])
def test_a_night_between_two_rows_or_a_leap_of_the_clock_takes_no_frames(seconds):
    t, position, power = columns()
    frames = frames_of_table(np.where(t < 2.5, t, t + seconds), position, power)
    assert len(frames) == 500
    assert not np.isnan(frames.values).any()
    assert frames.time[-1] == pytest.approx((seconds + 4.99) * 1e9, rel=0, abs=1e3)


def test_a_clock_that_drifts_at_one_row_a_second_is_no_reason_to_refuse(tmp_path):
    (frames,) = frames_of_files([written(tmp_path / "slow.csv", 100.03)])
    assert len(frames) == pytest.approx(500, abs=2)


def test_a_table_of_bursts_is_refused_with_its_row():
    _, position, power = columns()
    burst = np.repeat(np.arange(100) * 0.1, 5) + np.tile(np.arange(5) * 1e-6, 100)
    with pytest.raises(RecordingError, match=r"most rows are 1e-06 s apart, row \d+6 is 0.099996 s after row \d+5:"):
        frames_of_table(burst, position, power)


def test_a_table_in_microseconds_is_refused(tmp_path):
    path = written(tmp_path / "a.csv", 1e6)
    with pytest.raises(RecordingError, match="rows are 10000 s apart, expected 1 s or less: is column t in seconds"):
        list(frames_of_files([path]))
