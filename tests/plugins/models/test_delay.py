"""Models that look some frames ahead of what they predict."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt import Prediction
from cellwatt_plugins.models import Input
from cellwatt_plugins.models.predict import predict_file
from tests.plugins.models.making import COLUMNS, Mlp, frames, metadata, outputs, run, split, stage

WINDOW, DELAY = 5, 2


@pytest.mark.parametrize("edges", [[], list(range(1, 40))])
@pytest.mark.parametrize("delay", [0, DELAY])
def test_predictions_carry_the_times_of_the_frames_they_are_for(tmp_path, values, edges, delay):
    network = Mlp.random(3, window=WINDOW)
    made = stage(network.save(tmp_path / "m.onnx", metadata(window=WINDOW, delay=delay)))
    block = frames(values)
    results = run(made, split(block, edges))
    predictions = [result for result in results if isinstance(result, Prediction)]
    assert sum((p.time for p in predictions), ()) == tuple(block.time[: 40 - delay].tolist())
    assert [p.sequence for p in predictions] == np.cumsum([0, *(len(p.time) for p in predictions[:-1])]).tolist()
    given = outputs(results)
    before = WINDOW - 1 - delay
    assert np.isnan(given[:before]).all()
    windows = np.stack([values[i : i + WINDOW][:, COLUMNS] for i in range(41 - WINDOW)])
    np.testing.assert_allclose(given[before:], network.truth(windows), rtol=0, atol=1e-4)


def test_predictions_around_skipped_frames_carry_their_own_sequence(tmp_path, values):
    made = stage(Mlp.random(3, window=WINDOW).save(tmp_path / "m.onnx", metadata(window=WINDOW, delay=DELAY)))
    blocks = split(frames(values), [10, 30])
    results = run(made, [blocks[0], blocks[2]])
    predictions = [result for result in results if isinstance(result, Prediction)]
    told = [(p.sequence + i, time) for p in predictions for i, time in enumerate(p.time)]
    assert told == [(i, frames(values).time[i]) for i in [*range(10), *range(30, 40 - DELAY)]]
    assert np.flatnonzero(np.isnan(outputs(results)[:, 0])).tolist() == [0, 1, 8, 9, 10, 11]


def test_offline_both_ends_of_a_motion_are_held(tmp_path):
    network = Mlp.random(4, inputs=1, window=WINDOW)
    told = metadata(inputs=(Input("joint_1.position", "rad"),), window=WINDOW, delay=DELAY)
    network.save(tmp_path / "m.onnx", told)
    q = np.random.default_rng(2).normal(size=12)
    table = {"t": 0.02 * np.arange(12), "move": np.repeat([0, 1], 6), "q_1": q}
    pq.write_table(pa.table(table), tmp_path / "moves.parquet")
    report = predict_file(tmp_path / "m.onnx", tmp_path / "moves.parquet", tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["power"].to_numpy()
    for first in (0, 6):
        padded = np.concatenate([[q[first]] * 2, q[first : first + 6], [q[first + 5]] * 2])
        windows = np.stack([padded[i : i + WINDOW] for i in range(6)])[:, :, None]
        np.testing.assert_allclose(said[first : first + 6], network.truth(windows)[:, 0], rtol=0, atol=1e-4)
    assert report.begun == 4
