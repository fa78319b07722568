import importlib

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.model import FittedTerm
from cellwatt_plugins.explain.simulators.callback import write_callback
from cellwatt_plugins.robot.effects import BY_NAME


@pytest.mark.parametrize("name", ["2.my-arm.mended.mjcf", "2.my-arm.mended.xml"])
def test_it_can_be_imported_whatever_the_file_is_called(tmp_path, monkeypatch, name):
    pytest.importorskip("mujoco")
    mended = tmp_path / name
    mended.write_text("<mujoco/>")
    stribeck = FittedTerm(Term(BY_NAME["stribeck_friction"], 0, (0.15,)), np.array([4.0]))
    beside = write_callback(mended, ['the "elbow"'], [stribeck])
    assert mended.read_text() == "<mujoco/>"
    monkeypatch.syspath_prepend(tmp_path)
    assert importlib.import_module(beside.stem).LAWS[0][0] == 'the "elbow"'
