"""``predict``: the same windows, inputs and refusals as live."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ModelError, RecordingError
from cellwatt_plugins.models import Input
from cellwatt_plugins.models.predict import predict_file
from cellwatt_plugins.models.tables import channel_of, read_table
from tests.plugins.models.making import Mlp, metadata

INPUTS = (Input("joint_1.position", "rad"), Input("joint_1.velocity", "rad/s"), Input("supply.power", "W"))
PLACE = Path("moves.parquet")


def columns(count=60, seed=0):
    rng = np.random.default_rng(seed)
    time = 0.02 * np.arange(count)
    time[40:] += 5.0
    return {
        "t": time,
        "move": np.where(np.arange(count) < 25, 0, 1),
        "label": [f"row {i}" for i in range(count)],
        "q_1": rng.normal(size=count),
        "qd_1": rng.normal(size=count),
        "power": rng.normal(size=count),
    }


def save(folder, model: Mlp, table, window=1, suffix=".parquet", **changes):
    model.save(folder / "model.onnx", metadata(inputs=INPUTS, window=window, rate_hz=50.0, **changes))
    path = folder / f"moves{suffix}"
    if suffix == ".parquet":
        pq.write_table(pa.table(table), path)
    else:
        rows = zip(*table.values(), strict=True)
        path.write_text("\n".join([",".join(table), *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def said(folder, source):
    report = predict_file(folder / "model.onnx", source, folder / "said.parquet")
    return report, pq.read_table(folder / "said.parquet")


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_columns_become_channels_and_what_numbers_the_rows_is_kept(tmp_path, suffix):
    model, table = Mlp.random(1, inputs=3, outputs=2), columns()
    report, given = said(tmp_path, save(tmp_path, model, table, suffix=suffix))
    assert given.column_names == ["t", "move", "power", "heat"]
    wanted = model.truth(np.column_stack([table["q_1"], table["qd_1"], table["power"]]))
    np.testing.assert_allclose(np.column_stack([given["power"], given["heat"]]), wanted, atol=1e-5)
    assert (report.rows, report.begun, report.missing) == (60, 0, 0)


def test_windows_begin_with_each_motion_and_hold_its_first_row(tmp_path):
    model, table = Mlp.random(1, inputs=3, outputs=2, window=4), columns()
    report, given = said(tmp_path, save(tmp_path, model, table, window=4))
    values = np.column_stack([table["q_1"], table["qd_1"], table["power"]])
    starts = np.repeat([0, 25, 40], [25, 15, 20])  # a new move, and a jump in time
    rows = np.maximum(np.arange(60)[:, None] + np.arange(-3, 1), starts[:, None])
    np.testing.assert_allclose(given["power"].to_numpy(), model.truth(values[rows])[:, 0], atol=1e-5)
    assert report.begun == 9
    assert "9 rows at the start of a motion were predicted as if the arm had rested" in report.in_words()


def test_missing_values_have_no_prediction_and_far_ones_are_told(tmp_path):
    table = columns()
    table["qd_1"][7] = np.nan
    table["q_1"][[3, 9]] = 50.0
    report, given = said(tmp_path, save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table))
    assert np.flatnonzero(np.isnan(given["power"].to_numpy())).tolist() == [7]
    assert report.missing == 1
    assert report.outside == {"joint_1.position": 2}
    assert "warning: joint_1.position is outside the range of the training in 2 rows" in report.in_words()


def test_another_rate_or_a_missing_column_is_refused(tmp_path):
    table = columns()
    source = save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table | {"t": 0.008 * np.arange(60)})
    with pytest.raises(ModelError, match=r"trained on rows at 50 Hz, those of .* come at 125 Hz"):
        said(tmp_path, source)
    del table["power"]
    source = save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table)
    with pytest.raises(
        RecordingError, match=r"input 3 of 3 of the model, 'supply.power' in W; there are: t, move, q_1"
    ):
        said(tmp_path, source)


def test_an_optional_input_may_be_absent():
    one = np.ones(3)
    assert channel_of("joint_1.approach", {"q_1": one}, PLACE) is None
    way = channel_of("joint_1.approach", {"q_1": one, "q_from_1": 0.25 * one}, PLACE)
    np.testing.assert_array_equal(way, 0.75 * one)


def test_names_of_channels():
    one = np.ones(3)
    for name, channel in (
        ("arm.joint_2.position", "joint_2.position"),
        ("actual_q_2", "joint_2.position"),
        ("tau_2", "joint_2.torque"),
        ("power", "supply.power"),
    ):
        assert channel_of(channel, {name: one}, PLACE) is one
    assert channel_of("joint_2.position", {"joint_12.position": one}, PLACE) is None
    with pytest.raises(RecordingError, match=r"left\.joint_2\.position and right\.joint_2\.position are there"):
        channel_of("joint_2.position", {"left.joint_2.position": one, "right.joint_2.position": one}, PLACE)


def test_joints_counted_from_0():
    columns = {"q_0": np.zeros(1), "q_1": np.ones(1), "q_from_0": np.full(1, -2.0), "current_1": np.full(1, 5.0)}
    assert channel_of("joint_2.position", columns, Path("t.csv")) is columns["q_1"]
    assert channel_of("joint_1.approach", columns, Path("t.csv")) == [2.0]
    assert channel_of("joint_1.current", columns, Path("t.csv")) is columns["current_1"]
    assert channel_of("joint_3.position", columns, Path("t.csv")) is None


def test_what_is_no_table_is_refused(tmp_path):
    for name, content in (("a.parquet", b"PAR"), ("b.csv", b"")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(RecordingError, match=r"cannot be read as a table"):
            read_table(tmp_path / name)
    pq.write_table(pa.table({"q_1": pa.array([], pa.float64())}), tmp_path / "c.parquet")
    with pytest.raises(RecordingError, match="has no rows"):
        read_table(tmp_path / "c.parquet")
