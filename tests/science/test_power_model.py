"""NLS, SCG and what goes beyond them, on arms whose physics shares no code with the models, and on a real UR3e."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.models.power.moves import read_moves
from cellwatt_plugins.models.power.nls import Nls
from cellwatt_plugins.models.power.paper import Seen
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.training import estimate, train
from cellwatt_plugins.models.power.tuning import tune
from cellwatt_plugins.robot import Arm
from tests.plugins.models.power.cases import model_of, read_case
from tests.plugins.models.power.emulated_arm import ARMS, six_axes

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
NOISE = {"six axes": 0.7, "seven axes": 0.7, "burdened": 1.2, "rippled": 0.7}
"""W of the emulated power."""


@pytest.mark.slow  # both are trained and scored in tests/plugins/models/power/test_train_command.py
@pytest.mark.timeout(300)
def test_the_papers_two_methods_reach_its_figures(tmp_path):
    arm, known, unseen = read_case(tmp_path, "six axes", 11, moves=40, unseen=16)
    tuning = tune(known, arm)
    seen, here = Seen.of(known, arm, tuning), Seen.of(unseen, arm, tuning)
    nls = Nls.fit(known, seen, arm.description)
    assert Score.of(unseen, *nls.predict(here)).energy_mean <= 1.54
    assert Score.of(unseen, *Scg.fit(known, seen).predict(here)).energy_mean <= 0.89
    assert nls.power[0] == pytest.approx(80, rel=0.02)  # P_c
    assert (nls.errors[1][0] > 0) and (nls.errors[1][0] < 0.1)


@pytest.mark.parametrize("kind", list(ARMS))
@pytest.mark.timeout(300)
@pytest.mark.slow
def test_the_best_model_on_faster_and_slower_moves(tmp_path, kind):
    """A hose that no term is for costs the most."""
    arm, known, unseen = read_case(tmp_path, kind, 21)
    score = Score.of(unseen, *estimate(model_of(known, arm), unseen, arm))
    assert score.energy_mean <= 0.4
    assert score.energy_worst <= 1.5
    assert score.power <= 1.3 * NOISE[kind]
    assert max(score.current) <= (0.1 if kind == "rippled" else 0.045)


@pytest.mark.slow
def test_what_an_arm_has_is_found(tmp_path):
    arm, known, _ = read_case(tmp_path, "six axes", 31, moves=8, unseen=1)
    fitted = model_of(known, arm)
    arm = six_axes(np.random.default_rng(31))
    model = fitted.model
    assert model.supply is not None
    assert model.supply.standby == pytest.approx(arm.standby, abs=0.5)
    assert 1 / model.supply.up == pytest.approx(arm.efficiency, rel=0.03)
    assert model.supply.down == pytest.approx(0, abs=0.1)
    assert any("Stribeck" in effect for effect in fitted.structure.effects)
    viscous = model.weights[model.terms.index("viscous")]
    assert viscous[:3] == pytest.approx(arm.viscous[:3], rel=0.15)


@pytest.mark.skipif(not (DATA / "ur3e_power").is_dir(), reason="the recordings of the UR3e are not here")
@pytest.mark.timeout(300)
@pytest.mark.slow
def test_five_short_moves_of_a_real_ur3e(tmp_path):
    sys.modules.pop("models", None)
    from models import ur3e

    arm = Arm.load(ur3e.write_robot(tmp_path))
    trained = train(read_moves(ur3e.write_moves(DATA, tmp_path), arm.description.names), arm)
    best = trained.scores["best"]
    assert best.power <= 3.0
    assert best.energy_mean <= 2.5
    assert best.power < trained.scores["NLS"].power
