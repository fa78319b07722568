"""Inputs that may be missing: the model is given NaN for them, live and offline."""

from __future__ import annotations

import numpy as np
import pytest
from onnx import helper, numpy_helper

from cellwatt_plugins.models import Input, Output
from tests.plugins.models.making import alarms, frames, metadata, run, save, stage, tensor

INPUTS = (
    Input("joint_1.position", "rad"),
    Input("tool.payload", "kg", optional=True),
    Input("supply.voltage", "V", optional=True),
)


def pass_through(path, window=1):
    """A model whose outputs are its inputs: those of the oldest frame it sees."""
    shape, node, weights = ["n", 3], helper.make_node("Identity", ["x"], ["y"]), []
    if window > 1:
        shape, node = ["n", window, 3], helper.make_node("Gather", ["x", "first"], ["y"], axis=1)
        weights = [numpy_helper.from_array(np.array(0), "first")]
    told = metadata(inputs=INPUTS, outputs=tuple(Output(i.channel, i.unit) for i in INPUTS), window=window)
    return save(path, [node], [tensor("x", shape)], [tensor("y", ["n", 3])], told, weights)


@pytest.fixture
def block():
    """Frames with joint positions and a voltage that is missing for a while; nobody gives a payload."""
    values = np.random.default_rng(1).uniform(-2, 2, (12, 5)).astype(np.float32).astype(float)
    values[3:5, 4] = np.nan
    values[8, 0] = np.nan
    return frames(values)


def said(results):
    return np.stack([results[0].outputs[i.channel] for i in INPUTS], axis=1)


def test_what_is_not_there_is_nan_to_the_model(tmp_path, block):
    results = run(stage(pass_through(tmp_path / "m.onnx")), [block])
    wanted = np.column_stack([block.values[:, 0], np.full(12, np.nan), block.values[:, 4]])
    wanted[8] = np.nan  # a needed input is missing: no prediction at all
    np.testing.assert_array_equal(said(results), wanted)
    assert not alarms(results)


def test_windows_do_not_wait_for_it(tmp_path, block):
    results = run(stage(pass_through(tmp_path / "m.onnx", window=2)), [block])
    whole = [1, 2, 3, 4, 5, 6, 7, 10, 11]
    assert np.flatnonzero(np.isfinite(said(results)[:, 0])).tolist() == whole
    np.testing.assert_array_equal(said(results)[whole, 2], block.values[np.array(whole) - 1, 4])
