"""Measured and predicted power of a run, from a recording with known differences."""

from __future__ import annotations

import numpy as np

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.demo.power import power_of
from cellwatt.results import Prediction
from tests.daemon.record.making import SESSION, write_chunks

EPOCH = SESSION * 1e-9
LAYOUT = Layout((FrameChannel("board.supply.power", "W", "continuous", "average"),), 50.0)
STEP = 20_000_000


def frames(first: int, power: np.ndarray) -> Frames:
    time = SESSION + np.arange(first, first + len(power)) * STEP
    still = np.zeros((len(power), 1), np.int64)
    return Frames(LAYOUT, first, time, power[:, None], still.astype(np.uint8), still)


def said(block: Frames, off: float, model: str = "power") -> Prediction:
    power = tuple((block.values[:, 0] - off).tolist())
    return Prediction(model, block.sequence, tuple(block.time.tolist()), {"power": power}, {"power": "W"})


def test_differences_before_and_after_the_spring(tmp_path):
    before, after = frames(0, np.linspace(90.0, 110.0, 500)), frames(500, np.full(200, 150.0))
    items = [before, said(before, 2.0), said(before, 50.0, "another"), after, said(after, -20.0)]
    write_chunks(tmp_path, [items])
    found = power_of(tmp_path, EPOCH, EPOCH + 500 * STEP * 1e-9)
    assert found is not None
    assert found["frames"] == 700
    assert (found["rms_w"], found["rms_after_the_spring_w"]) == (2.0, 20.0)
    assert found["measured_mean_w"] == 100.0


def test_missing_values_and_what_an_earlier_run_left_do_not_count(tmp_path):
    power = np.full(100, 100.0)
    power[40:60] = np.nan
    block = frames(0, power)
    write_chunks(tmp_path, [[block, said(block, 1.0)]])
    found = power_of(tmp_path, EPOCH + 20 * STEP * 1e-9, EPOCH + 1e6)
    assert found is not None
    assert (found["frames"], found["rms_w"], found["rms_after_the_spring_w"]) == (60, 1.0, None)


def test_without_predictions_there_is_nothing_to_tell(tmp_path):
    write_chunks(tmp_path, [[frames(0, np.full(10, 100.0))]])
    assert power_of(tmp_path, EPOCH, EPOCH) is None
