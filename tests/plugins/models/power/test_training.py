"""Training where something was not measured, and what an arm that carries something needs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.power import fitting, scg_network, training, tuning
from cellwatt_plugins.models.power.folds import folds_of
from cellwatt_plugins.models.power.moves import Moves, read_moves
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.training import estimate, train
from cellwatt_plugins.models.power.wording import findings
from cellwatt_plugins.robot import Arm
from tests.plugins.models.power.cases import model_of, read_case, tuning_of
from tests.plugins.models.power.emulated_arm import recorded, six_axes, write_known
from tests.plugins.robot import planar_arm

# A training takes 20 s of an idle core, and cores are shared.
pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return read_case(tmp_path_factory.mktemp("case"), "six axes", 7, moves=12, unseen=4)


def swinging(folder: Path) -> tuple[Arm, Moves]:
    """A planar arm as its URDF says, with rotors and friction, in one long move without a rest."""
    joints = [{"name": name, "torque_constant": 10.0, "winding_resistance": 1.0} for name in ("shoulder", "elbow")]
    (folder / "robot.yaml").write_text(
        json.dumps({"robot": "planar", "urdf": planar_arm.write(folder).name, "joints": joints})
    )
    step, draw = 0.008, np.random.default_rng(0)
    time = step * np.arange(4000)
    rate, start = np.array([[1.3, 1.7], [3.8, 4.9]]), np.array([[0.0, 1.0], [2.0, 0.5]])
    angle = rate * time[:, None, None] + start
    size = np.array([[1.0, 1.2], [0.3, 0.4]])
    q, qd, qdd = (
        (size * each).sum(axis=1) for each in (np.sin(angle), rate * np.cos(angle), -(rate**2) * np.sin(angle))
    )
    current = (planar_arm.torque(q, qd, qdd) + 0.8 * qdd + 3 * np.tanh(qd / 0.005) + 2 * qd) / 10
    noisy = [each + noise * draw.normal(size=q.shape) for each, noise in ((q, 2e-5), (qd, 2.5e-3), (current, 0.02))]
    move = np.zeros(len(time), np.int64)
    return Arm.load(folder), Moves(move, time, *noisy, np.full(len(time), np.nan))


@pytest.fixture(scope="module")
def partial(case):
    """A training without the third joint's current, with few windows and widths to try and no network."""
    arm, known, _ = case
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning, "SPANS", (5, 21))
        patch.setattr(tuning, "WIDTHS", (0.004,))
        patch.setattr(fitting, "_network_helps", lambda *_: False)
        return train(replace(known, current=np.where(np.arange(6) == 2, np.nan, known.current)), arm)


def test_a_joint_whose_current_is_dead_leaves_those_of_the_others(case, partial):
    arm, _, unseen = case
    assert list(partial.scores) == ["best"]
    assert partial.scores["best"].current[2] is None
    score = Score.of(unseen, *estimate(partial.fitted, unseen, arm))
    assert max(share for joint, share in enumerate(score.current) if joint != 2) < 0.2
    assert score.power < 0.15 * unseen.power.std()


@pytest.mark.parametrize(("up", "possible"), [(1.1, True), (-1.1, False), (0.003, False)])
def test_an_efficiency_that_cannot_be_is_remarked(partial, up, possible):
    supply = replace(partial.fitted.model.supply, up=up)
    fitted = replace(partial.fitted, model=replace(partial.fitted.model, supply=supply))
    text = "\n".join(findings(replace(partial, fitted=fitted)))
    assert f"efficiency {1 / up:.3f}" in text
    assert ("impossible, power does not follow the motion" in text) != possible


def test_a_short_piece_between_gaps_does_not_shorten_the_windows(case, monkeypatch):
    monkeypatch.setattr(tuning, "SPANS", (5, 21))
    monkeypatch.setattr(tuning, "WIDTHS", (0.004,))
    arm, known, _ = case
    cut = known.move + (np.arange(len(known)) >= len(known) - 12)
    assert tuning.tune(replace(known, move=cut), arm).smoother.window == 21


def test_blocks_of_one_long_move_are_predicted_as_well_as_moves(tmp_path):
    """Windows cross neither the hole that a held-out block leaves, nor end with a rest at the block's ends."""
    arm, one = swinging(tmp_path)
    fold = folds_of(one)
    assert np.unique(fold).tolist() == list(range(8))
    for k in (2, 5):
        for method in ("best", "NLS"):
            part = (method, k, tuning_of(one), fitting.Structure((), (), "bus", 3.0))
            _, current = training._done(part, training._Known(one, arm, fold))
            error = np.sqrt(np.mean((current - one.current[fold == k]) ** 2, axis=0)) / one.current.std(axis=0)
            assert error.max() < 0.08, (method, k)


def test_a_current_of_the_opposite_sign_is_refused(tmp_path):
    arm, one = swinging(tmp_path)
    with pytest.raises(RecordingError, match="the current of elbow has the opposite sign"):
        fitting.structure_of(replace(one, current=one.current * [1, -1]), arm, tuning_of(one))


def test_a_move_without_currents_does_not_hide_the_effects(case):
    arm, known, _ = case
    few = known.only(range(8))
    current = np.where(few.move[:, None] == 7, np.nan, few.current)
    found = fitting.structure_of(replace(few, current=current), arm, tuning_of(few))
    assert any("Stribeck" in effect for effect in found.effects)


@pytest.mark.slow
def test_power_alone_gives_a_model_of_power(case):
    """Without currents there is nothing to tell effects by, and priors have to do."""
    arm, known, unseen = case
    trained = train(replace(known, current=np.full(known.q.shape, np.nan)), arm)
    assert list(trained.scores) == ["best"]
    assert trained.nls is None
    power, _ = estimate(trained.fitted, unseen, arm)
    score = Score.of(unseen, power, unseen.current)
    assert score.energy_mean < 2
    assert score.power < 0.25 * unseen.power.std()


@pytest.mark.slow
def test_currents_alone_give_a_model_of_currents(case, monkeypatch):
    monkeypatch.setattr(scg_network, "ITERATIONS", 10)
    arm, known, unseen = case
    trained = train(replace(known, power=np.full(len(known), np.nan)), arm)
    assert trained.fitted.model.supply is None
    power, current = estimate(trained.fitted, unseen, arm)
    assert np.isnan(power).all()
    assert max(Score.of(unseen, power, current).current) < 0.2


@pytest.mark.slow
def test_a_payload_that_was_recorded_is_an_input(tmp_path):
    draw = np.random.default_rng(9)
    arm = six_axes(draw)
    described = Arm.load(write_known(arm, tmp_path, draw))
    files = [tmp_path / f"{load}.parquet" for load in (0.0, 2.0, 1.0)]
    for file in files:
        table = recorded(replace(arm, payload=float(file.stem)), draw, 3, (0.6, 1.4))
        pq.write_table(table.append_column("payload", pa.array([float(file.stem)] * table.num_rows)), file)
    unseen = read_moves(files[2:], described.description.names)
    fitted = model_of(read_moves(files[:2], described.description.names), described)
    told = Score.of(unseen, *estimate(fitted, unseen, described))
    ignored = Score.of(unseen, *estimate(fitted, replace(unseen, payload=np.zeros(len(unseen))), described))
    assert told.power < 0.5 * ignored.power
    assert told.current[1] < 0.5 * ignored.current[1]
    mass = fitted.model.inertial[-4]
    assert mass == pytest.approx(1.0, abs=0.05)
    assert fitted.model.inertial[-1] / mass == pytest.approx(0.08, abs=0.03)  # where the test's payload sits
