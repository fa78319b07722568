"""Small made files in published formats, through ``cellwatt import``, against what was put into them."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from scipy.io import savemat

from cellwatt import Batch
from cellwatt.commands.import_data import command
from cellwatt.errors import ConfigError, RecordingError
from cellwatt.imports import read_map, read_parts, shipped_maps
from cellwatt.imports.parts import _flat, _tree
from cellwatt.record import Recording


def called(*words):
    return CliRunner().invoke(command, list(map(str, words)), catch_exceptions=False)


def frames_of(folder):
    blocks = list(Recording.open(folder).frames())
    return blocks[0].layout, np.concatenate([b.time for b in blocks]), np.concatenate([b.values for b in blocks])


def voraus(path, samples=2, rows=200, without=()):
    """As voraus_ad.py names its columns, two repetitions at 100 Hz."""
    time = np.tile(np.arange(rows) / 100, samples)
    columns = {"time": time, "sample": np.repeat(np.arange(samples), rows), "category": np.full(len(time), 12)}
    for i in range(1, 7):
        columns[f"joint_position_{i}"] = i + 0.1 * time
        columns[f"joint_velocity_{i}"] = np.full(len(time), 0.1)
        columns[f"motor_torque_{i}"] = np.full(len(time), 2.0 * i)
        columns[f"motor_iq_{i}"] = np.full(len(time), 0.5 * i)
    columns["robot_voltage"], columns["robot_current"] = np.full(len(time), 48.0), 2.0 + 0.5 * time
    pq.write_table(pa.table({n: c for n, c in columns.items() if n not in without}), path)


def irs_path(rows=300):
    time = np.arange(rows)[:, None] / 100
    return {
        "measured_time": time,
        "measured_timestamps": 1e9 * time,
        "measured_active_power": 300 + 10 * time,
        "measured_IRs_position": np.tile([0.0, 90.0, -90.0, 45.0, 30.0, 180.0], (rows, 1)) + 10 * time,
        "measured_IRs_velocity": np.full((rows, 6), 10.0),
    }


def test_voraus_ad(tmp_path):
    voraus(tmp_path / "data.parquet")
    done = called("voraus-ad", tmp_path / "data.parquet", "--out", tmp_path / "out", "--json")
    report = json.loads(done.stdout)
    assert (report["parts"], report["samples"]) == (2, 400)
    assert report["licence"].startswith("CC BY-NC-SA 4.0") and "units" in report["unverified"]
    recording = Recording.open(tmp_path / "out")
    raw = [entry for entry in recording.entries() if isinstance(entry, Batch)]
    assert sum(map(len, raw)) == 400
    assert [batch.sequence for batch in raw[1:]] == np.cumsum([len(batch) for batch in raw])[:-1].tolist()
    layout, time, values = frames_of(tmp_path / "out")
    assert layout.rate == 100.0
    inside = (time - time[0] > 0.1e9) & (time - time[0] < 1.9e9)
    seconds = (time[inside] - 1_000_000_000_000_000_000) * 1e-9
    assert values[inside, layout.index("joint_2.position")] == pytest.approx(2 + 0.1 * seconds, abs=1e-6)
    assert values[inside, layout.index("supply.power")] == pytest.approx(48 * (2 + 0.5 * seconds), rel=1e-3)
    assert values[inside, layout.index("joint_6.current")] == pytest.approx(3.0)


def test_angles_modulo_a_turn_have_no_frame_in_between(tmp_path):
    voraus(tmp_path / "data.parquet", samples=1)
    table = pq.read_table(tmp_path / "data.parquet")
    angle = 2.9 + 0.5 * table["time"].to_numpy()
    turned = np.mod(angle + np.pi, 2 * np.pi) - np.pi
    at = table.column_names.index("joint_position_2")
    pq.write_table(table.set_column(at, "joint_position_2", pa.array(turned)), tmp_path / "data.parquet")
    called("voraus-ad", tmp_path / "data.parquet", "--out", tmp_path / "out")
    layout, _, values = frames_of(tmp_path / "out")
    found = values[:, layout.index("joint_2.position")]
    found = found[np.isfinite(found)]
    assert np.ptp(found) == pytest.approx(0.5 * 1.99, abs=0.02)
    assert np.max(np.abs(np.diff(found))) < 0.01


def test_between_two_repetitions_nothing_is_made_up(tmp_path):
    voraus(tmp_path / "data.parquet")
    called("voraus-ad", tmp_path / "data.parquet", "--out", tmp_path / "out")
    layout, time, values = frames_of(tmp_path / "out")
    gap = (time - time[0] > 3e9) & (time - time[0] < 6e9)
    assert gap.any() and np.isnan(values[gap, layout.index("joint_1.position")]).all()


def test_irs_data(tmp_path):
    motions = {f"motion_{i}": {f"path_{j}": irs_path() for j in (0, 1, 2, 10)} for i in range(2)}
    savemat(tmp_path / "data.mat", {"motions": motions})
    done = called("irs-data", tmp_path / "data.mat", "--out", tmp_path / "out", "--parts", 2, "--json")
    assert json.loads(done.stdout)["parts"] == 2
    layout, time, values = frames_of(tmp_path / "out")
    inside = (time - time[0] > 0.1e9) & (time - time[0] < 2.8e9)
    seconds = (time[inside] - 1_000_000_000_000_000_000) * 1e-9
    assert values[inside, layout.index("joint_2.position")] == pytest.approx(np.deg2rad(90 + 10 * seconds), abs=1e-6)
    assert values[inside, layout.index("joint_3.velocity")] == pytest.approx(np.deg2rad(10))
    assert values[inside, layout.index("supply.power")] == pytest.approx(300 + 10 * seconds, rel=1e-3)
    names = [part.name for part in read_parts(tmp_path / "data.mat", read_map("irs-data"))]
    assert names[:4] == [f"motions/motion_0/path_{j}" for j in (0, 1, 2, 10)]
    assert len(names) == 8


def test_irtp_2700_has_two_clocks(tmp_path):
    path = {
        "IR_trajectory_data": {
            "time": np.arange(300)[:, None] / 100,
            "joint_position": np.tile(np.arange(6.0), (300, 1)),
            "joint_velocity": np.zeros((300, 6)),
        },
        "power_meter_measurements": {"time": np.arange(30)[:, None] / 10, "power": np.full((30, 1), 250.0)},
    }
    savemat(tmp_path / "data.mat", {"motions": {"motion_0": {"path_0": path}}})
    done = called("irtp-2700", tmp_path / "data.mat", "--out", tmp_path / "out")
    assert "1 parts, 330 samples" in done.output and "licence: none stated" in done.output
    layout, time, values = frames_of(tmp_path / "out")
    inside = (time - time[0] > 0.3e9) & (time - time[0] < 2.5e9)
    assert values[inside, layout.index("meter.supply.power")] == pytest.approx(250.0)
    assert values[inside, layout.index("joint_4.position")] == pytest.approx(np.deg2rad(3))


def test_groups_of_hdf5_are_turned():
    """MATLAB 7.3 stores an (N, 6) matrix as (6, N)."""

    class Group(dict):
        pass

    tree = _tree(Group(path_0=Group(q=np.zeros((6, 9)), t=np.zeros((1, 9))), **{"#refs#": np.zeros(1)}))
    found = _flat(tree)
    assert found["path_0.q"].shape == (9, 6) and found["path_0.t"].shape == (9,)
    assert len(found) == 2


def test_a_map_of_the_users_own(tmp_path):
    pq.write_table(pa.table({"ms": [0.0, 10, 20, 30], "angle": [0.0, 90, 180, 270]}), tmp_path / "data.parquet")
    (tmp_path / "mine.yaml").write_text(
        "title: mine\nlicence: mine\ndocumented: here\njoints: 1\nsources:\n  arm:\n    time: ms\n    seconds: 0.001\n"
        "    channels:\n      joint_1.position: {column: angle, unit: rad, factor: 0.017453292519943295}\n"
    )
    part = next(iter(read_parts(tmp_path / "data.parquet", read_map(str(tmp_path / "mine.yaml")))))
    assert part.sources["arm"].time == pytest.approx([0, 0.01, 0.02, 0.03])
    assert part.sources["arm"].values[:, 0] == pytest.approx([0, np.pi / 2, np.pi, 1.5 * np.pi])


@pytest.mark.parametrize("name", shipped_maps())
def test_a_shipped_map_says_where_it_is_from(name):
    columns = read_map(name)
    assert columns.licence and "github.com" in columns.documented


def test_what_is_wrong_is_said(tmp_path):
    voraus(tmp_path / "less.parquet", without=("joint_velocity_3",))
    with pytest.raises(RecordingError, match=r"less\.parquet: sample 0: no column joint_velocity_3; there are: "):
        called("voraus-ad", tmp_path / "less.parquet", "--out", tmp_path / "out")
    with pytest.raises(ConfigError, match="no format is called 'ecbot': take irs-data, irtp-2700, voraus-ad"):
        read_map("ecbot")
    (tmp_path / "bad.yaml").write_text("title: x\n")
    with pytest.raises(ConfigError, match=r"bad\.yaml:1:1: the key 'licence' is missing"):
        read_map(str(tmp_path / "bad.yaml"))
    (tmp_path / "no.mat").write_bytes(b"nothing")
    with pytest.raises(RecordingError, match=r"no\.mat: cannot be read as a MATLAB file"):
        called("irs-data", tmp_path / "no.mat", "--out", tmp_path / "out")
    voraus(tmp_path / "back.parquet")
    table = pq.read_table(tmp_path / "back.parquet")
    pq.write_table(table.set_column(0, "time", pa.array(np.zeros(table.num_rows))), tmp_path / "back.parquet")
    with pytest.raises(RecordingError, match="time is empty or does not rise"):
        called("voraus-ad", tmp_path / "back.parquet", "--out", tmp_path / "other")
    voraus(tmp_path / "data.parquet")
    called("voraus-ad", tmp_path / "data.parquet", "--out", tmp_path / "twice")
    with pytest.raises(RecordingError, match="holds recordings"):
        called("voraus-ad", tmp_path / "data.parquet", "--out", tmp_path / "twice")
