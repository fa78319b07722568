import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.faults.recordings import APART, frames_of_files, frames_of_table


def columns(n=500, joints=2, **more):
    t = np.arange(n) / 100
    table = {f"q_{j}": np.sin(t + j) for j in range(1, joints + 1)}
    return t, {**table, "power": 90 + t, **more}


def test_a_table_becomes_frames():
    t, table = columns(extra=np.zeros(500))
    frames = frames_of_table(t, table)
    assert frames.layout.rate == 100.0
    assert frames.layout.names == ("table.joint_1.position", "table.joint_2.position", "table.supply.power")
    assert len(frames) == 500
    assert frames.values[:, 0] == pytest.approx(table["q_1"])
    assert frames.values[:, 2] == pytest.approx(table["power"])
    assert np.all(np.diff(frames.time) == 10_000_000)


def test_uneven_times_are_brought_onto_the_grid():
    random = np.random.default_rng(1)
    t, table = columns()
    uneven = t + random.uniform(-0.003, 0.003, len(t))
    frames = frames_of_table(uneven, {name: np.interp(uneven, t, values) for name, values in table.items()})
    grid = uneven[0] + np.arange(len(frames)) / frames.layout.rate
    assert frames.values[:, 0] == pytest.approx(np.sin(grid + 1), abs=1e-3)


def test_holes_are_missing():
    t, table = columns()
    keep = (t < 2.0) | (t >= 2.5)
    frames = frames_of_table(t[keep], {name: values[keep] for name, values in table.items()})
    assert len(frames) == 500
    assert np.isnan(frames.values[205:245]).all()
    assert not np.isnan(frames.values[:199]).any()
    assert not np.isnan(frames.values[251:]).any()
    assert (frames.quality[np.isnan(frames.values)] == 4).all()


@pytest.mark.parametrize("drop", ["q_1", "power"])
def test_missing_columns_are_named(drop):
    t, table = columns()
    del table[drop]
    with pytest.raises(RecordingError, match=r"robot\.csv: expected columns t, q_1 … q_n and power; there are: "):
        frames_of_table(t, table, name="robot.csv")


def test_files_follow_each_other_apart(tmp_path):
    t, table = columns()
    text = (
        ",".join(["t", *table])
        + "\n"
        + "\n".join(",".join(map(str, row)) for row in zip(t, *table.values(), strict=True))
    )
    (tmp_path / "a.csv").write_text(text)
    pq.write_table(pa.table({"t": t, **table}), tmp_path / "b.parquet")
    blocks = list(frames_of_files([tmp_path / "a.csv", tmp_path / "b.parquet"]))
    assert [len(b) for b in blocks] == [500, 500]
    assert blocks[0].layout == blocks[1].layout
    assert blocks[1].time[0] - blocks[0].time[-1] >= APART
    assert blocks[1].values == pytest.approx(blocks[0].values)


def test_recordings_and_tables_do_not_mix(tmp_path):
    with pytest.raises(RecordingError, match="cannot be mixed"):
        list(frames_of_files([tmp_path / "a.csv", tmp_path / "b.mcap"]))


def test_a_folder_without_recordings(tmp_path):
    with pytest.raises(RecordingError):
        list(frames_of_files([tmp_path]))
