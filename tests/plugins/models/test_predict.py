"""``predict``: the same windows, inputs and refusals as live."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ModelError, RecordingError
from cellwatt.tables import Table
from cellwatt_plugins.models import Input
from cellwatt_plugins.models import predict as predicting
from cellwatt_plugins.models.predict import inputs_of, predict_file
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


def save(folder, model: Mlp, table, suffix=".parquet"):
    model.save(folder / "model.onnx", metadata(inputs=INPUTS, window=model.window))
    path = folder / f"moves{suffix}"
    write = pq.write_table if suffix == ".parquet" else pyarrow.csv.write_csv
    write(pa.table(table), path)
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


@pytest.mark.parametrize("odd", [np.inf, -np.inf, np.nan, 1e300, 2.0**63])
def test_a_number_of_a_row_that_is_no_integer_is_copied_as_it_is(tmp_path, odd):
    table = columns() | {"pose": np.append(np.arange(59.0), odd)}
    given = said(tmp_path, save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table))[1]
    np.testing.assert_array_equal(given["pose"].to_numpy(), table["pose"])


def test_a_table_that_names_the_joints_is_read_in_the_order_of_the_model(tmp_path):
    model, rng = Mlp.random(1, inputs=2, outputs=2), np.random.default_rng(2)
    inputs = (Input("joint_1.position", "rad"), Input("joint_2.position", "rad"))
    model.save(tmp_path / "model.onnx", metadata(inputs=inputs, joints=("shoulder_joint", "elbow_joint")))
    table = {"t": 0.02 * np.arange(60)}
    table |= {f"{name}_joint_position": rng.normal(size=60) for name in ("elbow", "shoulder")}
    pq.write_table(pa.table(table), tmp_path / "named.parquet")
    _, given = said(tmp_path, tmp_path / "named.parquet")
    wanted = model.truth(np.column_stack([table["shoulder_joint_position"], table["elbow_joint_position"]]))
    np.testing.assert_allclose(np.column_stack([given["power"], given["heat"]]), wanted, atol=1e-5)


def test_windows_begin_with_each_motion_and_hold_its_first_row(tmp_path):
    model, table = Mlp.random(1, inputs=3, outputs=2, window=4), columns()
    report, given = said(tmp_path, save(tmp_path, model, table))
    values = np.column_stack([table["q_1"], table["qd_1"], table["power"]])
    starts = np.repeat([0, 25, 40], [25, 15, 20])  # a new move, and a jump in time
    rows = np.maximum(np.arange(60)[:, None] + np.arange(-3, 1), starts[:, None])
    np.testing.assert_allclose(given["power"].to_numpy(), model.truth(values[rows])[:, 0], atol=1e-5)
    assert report.begun == 9
    assert "9 rows at the start of a motion were predicted as if the arm had been at rest" in report.in_words()


def test_moves_by_name_are_refused_only_where_windows_need_them(tmp_path):
    table = columns() | {"move": np.repeat(["pick", "place"], 30)}
    report, given = said(tmp_path, save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table))
    assert (report.rows, given.column_names) == (60, ["t", "power", "heat"])
    with pytest.raises(RecordingError, match="column move holds text"):
        said(tmp_path, save(tmp_path, Mlp.random(1, inputs=3, outputs=2, window=4), table))


def test_missing_values_have_no_prediction_and_far_ones_are_told(tmp_path):
    table = columns()
    table["qd_1"][7] = np.nan
    table["q_1"][[3, 9]] = 50.0
    report, given = said(tmp_path, save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table))
    assert np.flatnonzero(np.isnan(given["power"].to_numpy())).tolist() == [7]
    assert report.missing == 1
    assert report.outside == {"joint_1.position": 2}
    assert "warning: joint_1.position is outside the range of the training in 2 rows" in report.in_words()


def test_a_long_table_is_predicted_some_rows_at_a_time(tmp_path, monkeypatch):
    source = save(tmp_path, Mlp.random(1, inputs=3, outputs=2, window=4), columns())
    whole = said(tmp_path, source)[1]
    monkeypatch.setattr(predicting, "AT_ONCE", 7)
    np.testing.assert_allclose(said(tmp_path, source)[1]["power"], whole["power"], atol=1e-6)


def test_the_noise_of_a_joint_that_rested_in_the_training_is_not_told():
    asked = metadata(inputs=INPUTS[:2])
    asked = replace(asked, training=replace(asked.training, range=((0.0, 1.0), (0.0, 0.0))))
    noise = np.column_stack([np.zeros(5), np.linspace(-0.009, 0.009, 5)])
    assert predicting._outside(asked, noise) == {}
    assert predicting._outside(asked, noise + np.array([0.0, 0.1])) == {"joint_1.velocity": 5}


def test_another_rate_or_a_missing_column_is_refused(tmp_path):
    table = columns()
    source = save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table | {"t": 0.008 * np.arange(60)})
    with pytest.raises(ModelError, match=r"trained on rows at 50 Hz, those of .* come at 125 Hz"):
        said(tmp_path, source)
    del table["power"]
    source = save(tmp_path, Mlp.random(1, inputs=3, outputs=2), table)
    with pytest.raises(RecordingError, match=r"input 3 of 3 of the model, 'supply.power' in W; there are: move, q_1"):
        said(tmp_path, source)


def test_how_an_arm_came_to_a_pose_is_told_by_where_it_came_from():
    one = np.ones(3)
    asked = metadata(inputs=(Input("joint_1.approach", "rad", optional=True),))
    assert np.isnan(inputs_of(asked, Table(PLACE, {"q_1": one}))).all()
    way = inputs_of(asked, Table(PLACE, {"q_0": one, "q_1": one, "q_from_0": 0.25 * one}))
    np.testing.assert_array_equal(way[:, 0], 0.75 * one)


def test_a_table_is_not_overwritten_by_its_own_predictions(tmp_path):
    source = save(tmp_path, Mlp.random(1, inputs=3, outputs=2), columns())
    before = source.read_bytes()
    with pytest.raises(RecordingError, match=r"moves\.parquet would be overwritten by its own predictions"):
        predict_file(tmp_path / "model.onnx", source, source)
    assert source.read_bytes() == before
