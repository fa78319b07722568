import sys

import numpy as np
import pyarrow as pa
import pytest

import cellwatt as cw
from cellwatt.errors import CellwattError, ConfigError, RecordingError

from .making import METER, SESSION, batch_of, frames_of, name_of, write_chunks
from .test_roundtrip import RESULTS


@pytest.fixture
def folder(tmp_path):
    for number, first in ((1, 0), (2, 20)):
        items = [batch_of(first, 20), frames_of(first, 20), batch_of(first, 20, stream=METER, source="supply")]
        write_chunks(tmp_path, [items, RESULTS if number == 1 else []], number=number)
    return tmp_path


TRUTH = np.concatenate([frames_of(0, 20).values, frames_of(20, 20).values])


def test_frames_are_a_pandas_frame_with_units(folder):
    with cw.open(str(folder)) as recording:
        frame = recording.frame()
    assert list(frame) == ["t", "utc_ns", *(f"arm.joint_{i}.position" for i in (1, 2, 3))]
    assert np.array_equal(frame.iloc[:, 2:], TRUTH)
    assert np.allclose(frame["t"], np.arange(40) * 0.02, rtol=0, atol=1e-12)
    assert frame["utc_ns"].tolist() == [SESSION + n * 20_000_000 for n in range(40)]
    assert frame.attrs["units"] == {"t": "s", "utc_ns": "ns"} | {f"arm.joint_{i}.position": "rad" for i in (1, 2, 3)}
    assert (frame.attrs["cell"], frame.attrs["start_utc_ns"]) == ("weld-3", SESSION)


def test_a_part_of_the_time_and_of_the_channels(folder):
    recording = cw.open([folder / name_of(1), folder / name_of(2)])
    frame = recording.frame(start=0.3, end=0.5, channels="joint_2.position")
    assert np.array_equal(frame["arm.joint_2.position"], TRUTH[15:26, 1])
    assert list(recording.frame(channels=["*_3.position", "arm.joint_1.position"]))[2:] == [
        "arm.joint_3.position",
        "arm.joint_1.position",
    ]
    with pytest.raises(ConfigError, match=r"no source has the channel 'torque'; available: arm\.joint_1"):
        recording.frame(channels="torque")
    with pytest.raises(RecordingError, match="no frames"):
        recording.frame(start=60)
    assert len(recording.within(0.3, 0.5).frames_table()) == 11 and len(recording.frames_table()) == 40


def test_quality_and_bound_on_demand(folder):
    frame = cw.open(folder / name_of(1)).frame(quality=True)
    truth = frames_of(0, 20)
    assert np.array_equal(frame["arm.joint_3.position.quality"], truth.quality[:, 2])
    assert np.array_equal(frame["arm.joint_3.position.bound_ns"], truth.bound[:, 2])


def test_raw_samples(folder):
    recording = cw.open(folder)
    assert recording.sources == ("arm", "supply")
    frame = recording.raw("supply/meter", end=0.02)
    truth = batch_of(0, 11, stream=METER)
    assert np.array_equal(frame["joint_2.position"], truth.values[:, 1])
    assert frame["sequence"].tolist() == list(range(11))
    assert frame["device_time_ns"].tolist() == truth.device_time.tolist()
    with pytest.raises(RecordingError, match=r"no stream supply/ .*; there are: arm/rtde, supply/meter"):
        recording.raw("supply")


def test_arrow_where_neither_pandas_nor_polars_is_installed(folder, monkeypatch):
    monkeypatch.setattr("cellwatt.record.tables.find_spec", lambda name: None)
    table = cw.open(folder).frame()
    assert isinstance(table, pa.Table)
    assert table.schema.field("arm.joint_1.position").metadata == {b"unit": b"rad"}
    assert np.array_equal(table["arm.joint_1.position"], TRUTH[:, 0])
    monkeypatch.setitem(sys.modules, "polars", None)
    with pytest.raises(CellwattError, match="library='polars' is not installed: pip install polars"):
        cw.open(folder).frame(library="polars")


def test_channels_have_units_with_frames_and_without(folder, tmp_path):
    assert cw.open(folder).channels == {f"arm.joint_{i}.position": "rad" for i in (1, 2, 3)}
    (tmp_path / "raw").mkdir()
    write_chunks(tmp_path / "raw", [[batch_of(0, 5, stream=METER, source="supply")]])
    raw = cw.open(tmp_path / "raw")
    assert raw.channels == {"supply.joint_1.position": "rad", "supply.joint_2.position": "rad"}
