"""Predictions against truth made by numpy from the same weights, however the frames are cut into blocks."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.plugins.models.making import COLUMNS, Mlp, alarms, frames, layout, metadata, outputs, run, split, stage


@pytest.mark.parametrize(("dtype", "within"), [(np.float32, 1e-5), (np.float64, 1e-12)])
def test_outputs_are_those_of_the_weights(tmp_path, values, dtype, within):
    network = Mlp.random(2)
    made = stage(network.save(tmp_path / "m.onnx", metadata(), dtype))
    truth = network.truth(values[:, COLUMNS])
    np.testing.assert_allclose(outputs(run(made, [frames(values)])), truth, rtol=0, atol=within * np.abs(truth).max())


def test_a_missing_input_gives_no_number(tmp_path, values):
    network = Mlp.random(2)
    made = stage(network.save(tmp_path / "m.onnx", metadata()))
    values[5, COLUMNS[0]] = values[9, COLUMNS[2]] = np.nan
    values[12, 3] = np.nan  # no input of the model
    values[20, COLUMNS[1]] = 1e39  # no float32
    values[21, COLUMNS[1]] = -np.inf
    given = outputs(run(made, [frames(values)]))
    assert np.flatnonzero(np.isnan(given).all(axis=1)).tolist() == [5, 9, 20, 21]
    assert np.isfinite(np.delete(given, [5, 9, 20, 21], axis=0)).all()


def test_a_window_with_a_missing_value_or_across_a_hole_gives_no_number(tmp_path, values):
    made = stage(Mlp.random(3, window=3).save(tmp_path / "m.onnx", metadata(window=3)))
    values[10, COLUMNS[0]] = np.nan
    block = frames(values)
    block.time[25:] += layout().step
    missing = np.flatnonzero(np.isnan(outputs(run(made, [block]))).all(axis=1))
    assert missing.tolist() == [0, 1, 10, 11, 12, 25, 26]


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(
    seed=st.integers(0, 2**32 - 1),
    window=st.sampled_from([1, 2, 5]),
    edges=st.lists(st.integers(0, 60), max_size=8),
    holes=st.sets(st.integers(0, 59), max_size=3),
)
def test_other_blocks_give_the_same(tmp_path, seed, window, edges, holes):
    rng = np.random.default_rng(seed)
    values = rng.uniform(-2, 2, (60, 5)) * rng.choice([1, 1, 1, 3], (60, 1))
    values[rng.random((60, 5)) < 0.02] = np.nan
    block = frames(values)
    for hole in holes:
        block.time[hole:] += layout().step
    path = Mlp.random(seed, hidden=100, window=window).save(tmp_path / "m.onnx", metadata(window=window))
    offline, live = run(stage(path), [block]), run(stage(path), split(block, edges))
    whole = outputs(offline)
    scale = np.nanmax(np.abs(whole), initial=0.0)
    np.testing.assert_allclose(outputs(live), whole, rtol=1e-6, atol=1e-6 * scale)
    assert alarms(live) == alarms(offline)


def test_a_model_tells_nobody_of_itself(tmp_path):
    path = Mlp.random(1).save(tmp_path / "m.onnx", metadata())
    home = tmp_path / "home"
    home.mkdir()
    code = f"from pathlib import Path; from cellwatt_plugins.onnx_file import OnnxFile; OnnxFile(Path({str(path)!r}))"
    where = {"HOME": str(home), "XDG_CACHE_HOME": str(home), "PYTHONPATH": os.pathsep.join(sys.path)}
    subprocess.run([sys.executable, "-c", code], env=where, check=True)
    assert list(home.rglob("*")) == [], "onnxruntime writes the PC's number there, for its reports"


def test_the_import_waits_for_a_model():
    code = "import sys, cellwatt_plugins.models; sys.exit('onnxruntime' in sys.modules or 'onnx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
