"""Model files against the formulas that they hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt_plugins.models import read_metadata
from cellwatt_plugins.models.network import Network
from cellwatt_plugins.models.static.exported import Widths, write_best, write_paper
from cellwatt_plugins.models.static.identify import identify, with_leftover
from cellwatt_plugins.models.static.paper import trained
from cellwatt_plugins.robot import Arm
from tests.plugins.models.making import frames, layout, run, stage
from tests.plugins.models.static import arms
from tests.plugins.models.static.test_identify import collection, known


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """An arm with every effect in its model, at random, and what is left over."""
    poses = collection(arms.some_arm(6), 1, 60)
    poses = replace(poses, payload=np.linspace(0, 4, 60))
    arm = known(tmp_path_factory.mktemp("robot"), poses)
    basis, effects = arm.basis(poses), arm.effects(poses)
    model = identify(basis, poses.torque, effects)
    p = 0.5 * effects.scale * np.random.default_rng(2).normal(size=len(effects.scale))
    p[effects.slices["zero"]] = 0.0  # the graph turns the angles themselves, the formula follows the slope
    everything = replace(model, posterior=replace(model.posterior, mean=p))
    return with_leftover(everything, basis, poses.torque), arm, poses


def save(folder: Path, fitted: tuple) -> Path:
    model, arm, poses = fitted
    write_best(folder / "model.onnx", model, Widths(2.0, 9.0), arm, poses)
    return folder / "model.onnx"


def inputs(poses) -> np.ndarray:
    return np.hstack([poses.q, poses.approach, poses.payload[:, None]])


def test_the_graph_is_the_formula(tmp_path, fitted):
    model, arm, poses = fitted
    network = Network(save(tmp_path, fitted))
    given = network.run(inputs(poses))
    basis = arm.basis(poses)
    np.testing.assert_allclose(given[:, :6], model.torque(basis), atol=1e-8)
    np.testing.assert_allclose(given[:, 6], model.total(basis), atol=1e-8)
    unknown = np.isnan(poses.approach).any(axis=1)
    assert unknown.sum() == 1
    width = np.where(unknown, 9.0, 2.0)
    np.testing.assert_allclose(given[:, 7], np.maximum(given[:, 6] - width, 0))
    np.testing.assert_allclose(given[:, 8], given[:, 6] + width)


def test_power_that_holds_a_pose_where_the_motors_are_known(tmp_path, fitted):
    model, arm, poses = fitted
    metadata = read_metadata(save(tmp_path, fitted))
    assert len(metadata.outputs) == 9  # nothing is known of the MH12's motors
    assert metadata.joints == tuple(f"joint_{i}" for i in range(1, 7))
    constant, resistance = np.linspace(20, 8, 6), np.linspace(0.4, 2.1, 6)
    joints = tuple(
        joint.model_copy(update={"torque_constant": k, "winding_resistance": r})
        for joint, k, r in zip(arm.arm.description.joints, constant.tolist(), resistance.tolist(), strict=True)
    )
    known = Arm.of(arm.arm.description.model_copy(update={"joints": joints}))
    path = save(tmp_path, (model, replace(arm, arm=known), poses))
    assert [(o.name, o.unit) for o in read_metadata(path).outputs][-1] == ("holding_power", "W")
    given = Network(path).run(inputs(poses))
    current = given[:, :6] / constant  # 000 (3)
    voltage = resistance * current  # 002 (3) of a motor that neither turns nor changes
    np.testing.assert_allclose(given[:, 9], (given[:, :6] * voltage / constant).sum(axis=1))  # 000 (4)


def test_live_it_says_the_same_and_needs_only_positions(tmp_path, fitted):
    _, _, poses = fitted
    file = save(tmp_path, fitted)
    grid = layout({f"arm.joint_{j}.position": "rad" for j in range(6, 0, -1)})
    values = poses.q[:, ::-1].copy()
    values[5, 2] = np.nan
    (prediction, *_) = run(stage(file, grid, robot="mh12"), [frames(values, grid)])
    table = inputs(replace(poses, approach=np.full_like(poses.q, np.nan), payload=np.full(60, np.nan)))
    wanted = Network(file).run(table)
    wanted[5] = np.nan
    for column, name in zip(wanted.T, prediction.outputs, strict=True):
        np.testing.assert_allclose(prediction.outputs[name], column, rtol=1e-6, atol=1e-6)
    with pytest.raises(ModelError, match="it is of robot 'mh12', the cell's robot is 'ur5'"):
        stage(file, grid, robot="ur5")


def test_the_papers_methods_are_files_too(tmp_path, fitted):
    _, arm, poses = fitted
    basis = arm.basis(poses)
    gravity = basis.vertical @ fitted[0].effects.cad
    simulated = np.abs(gravity).sum(axis=1)
    both = np.hstack([poses.q, gravity])
    plain, hybrid = trained(poses.q, poses.total, 12), trained(both, poses.total - simulated, 9)
    wanted = {"gravity": simulated, "network": plain(poses.q), "hybrid": simulated + hybrid(both)}
    networks = {"gravity": (None, True), "network": (plain, False), "hybrid": (hybrid, True)}
    for name, (network, with_gravity) in networks.items():
        write_paper(tmp_path / f"{name}.onnx", network, arm, poses, with_gravity)
        given = Network(tmp_path / f"{name}.onnx").run(poses.q)[:, 0]
        np.testing.assert_allclose(given, wanted[name], rtol=1e-9, atol=1e-8)
