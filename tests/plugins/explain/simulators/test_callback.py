import importlib
import runpy

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.model import FittedTerm
from cellwatt_plugins.explain.simulators.callback import write_callback
from cellwatt_plugins.robot.effects import BY_NAME
from tests.plugins.explain import plant


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


@pytest.mark.parametrize(
    ("name", "shape", "coefficients"),
    [
        ("stribeck_friction", (0.15,), (4.0,)),
        ("stribeck_friction", (0.15, 1.0), (4.0,)),
        ("nonlinear_viscous_friction", (0.5,), (2.0,)),
        ("position_periodic_torque", (11.0,), (3.0, 1.0)),
        ("position_periodic_torque", (11.0, 2.0), (3.0, 1.0, 0.5, -0.7)),
    ],
)
def test_its_torque_is_that_of_the_effect_in_each_of_its_forms(arm, tmp_path, name, shape, coefficients):
    pytest.importorskip("mujoco")
    fitted = FittedTerm(Term(BY_NAME[name], 0, shape), np.array(coefficients))
    beside = write_callback(tmp_path / "arm.mended.xml", ["axis_1"], [fitted])
    (_, law) = runpy.run_path(str(beside))["LAWS"][0]
    run = plant.states(arm)
    torque = law(run.q[:, 0], run.qd[:, 0], 0.0, 0.0, 0.0, lambda speed, size: run.sign[:, 0])
    assert torque == pytest.approx(fitted.course(run)[:, 0], abs=1e-6)
