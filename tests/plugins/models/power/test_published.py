"""The paper's two models: numbers that a motor can have, one k_m, doubts where they stand for else, and model files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.models.power.api import write_published
from cellwatt_plugins.models.power.moves import read_moves
from cellwatt_plugins.models.power.nls import HENRY, Nls
from cellwatt_plugins.models.power.paper import Seen
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.predict import predict_file
from tests.plugins.models.power.cases import six_axes_recorded, tuning_of


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Both models of an emulated arm, with what they are of."""
    folder = tmp_path_factory.mktemp("arm")
    arm, table = six_axes_recorded(folder, 8, 6, (0.6, 1.6))
    pq.write_table(table, folder / "moves.parquet")
    moves = read_moves([folder / "moves.parquet"], arm.description.names)
    seen = Seen.of(moves, arm, tuning_of(moves))
    models = {"nls": Nls.fit(moves, seen, arm.description), "scg": Scg.fit(moves, seen)}
    return arm, moves, seen, models, folder / "moves.parquet"


def test_numbers_are_those_that_a_motor_can_have(trained):
    arm, _, _, models, _ = trained
    nls = models["nls"]
    inductance, resistance = nls.power[1:].reshape(2, -1)
    stated = np.array([joint.winding_resistance for joint in arm.description.joints])
    assert ((inductance >= 0) & (inductance <= HENRY)).all()
    assert ((resistance >= 0.5 * stated) & (resistance <= 2 * stated)).all()
    assert (nls.joints[:, 1:4] >= 0).all()  # inertia, viscous, Coulomb


def test_one_k_m_serves_current_and_power(trained):
    """Mechanical work turns into power by the constant that turns torque into current: (12) and (13)."""
    _, _, seen, models, _ = trained
    nls = models["nls"]
    power, current = nls.predict(seen)
    inductance, resistance = nls.power[1:].reshape(2, -1)
    rest = nls.power[0] + (inductance * current * seen.rate(current) + resistance * current**2).sum(axis=1)
    work = (nls.joints[:, 0] * seen.motion.qd * current).sum(axis=1)
    assert power == pytest.approx(rest + work, abs=1e-9)


def test_a_supply_that_loses_more_is_told_as_a_k_m_that_stands_for_it(trained):
    """Power alone wants a larger constant wherever some is lost between the meter and the motors."""
    arm, moves, seen, _, _ = trained
    lossy = replace(moves, power=80 + 1.3 * (moves.power - 80))
    doubts = Nls.fit(lossy, seen, arm.description).doubts
    assert any(doubt.startswith("k_m of joint") and "from power" in doubt for doubt in doubts)


@pytest.mark.parametrize("name", ["nls", "scg"])
def test_the_file_says_what_the_model_says(trained, tmp_path, name):
    arm, moves, seen, models, table = trained
    metadata = write_published(tmp_path / "model.onnx", models[name], tuning_of(moves), moves, arm)
    assert metadata.name == f"{arm.name}-power-{name}"
    predict_file(tmp_path / "model.onnx", table, tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")
    power, current = models[name].predict(seen)
    within = np.concatenate([np.arange(a + metadata.window, b - metadata.window) for a, b in moves.bounds()])
    assert np.abs(said["power"].to_numpy() - power)[within].max() < 1e-6
    for i in range(6):
        assert np.abs(said[f"current_{i + 1}"].to_numpy() - current[:, i])[within].max() < 1e-6
