"""Uncertainty of a task's groups, against draws of the parameters and against causes put in by hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from energy.live import RATE
from energy.plant import production

from cellwatt.errors import ModelError
from cellwatt_plugins.energy.drive import features
from cellwatt_plugins.energy.electronics import at_campaign, followed
from cellwatt_plugins.energy.known import load_known
from cellwatt_plugins.energy.spread import GROUPS, deviations, group_slopes
from cellwatt_plugins.energy.task_energy import Stretch, task_energy
from cellwatt_plugins.robot import Arm

DRAWS = 4000


@pytest.fixture(scope="module")
def stretch(measured):
    """Once round, without payload."""
    case, _, key = measured
    seen, power, _ = production(case, key["fixed"], 700.0, 0.0, 1, 0.5, RATE)
    return Stretch(1 / RATE, seen["position"], seen["velocity"], seen["torque"], power)


def drawn(known, generator):
    """As the campaign might have found the arm."""
    vector = generator.multivariate_normal(np.zeros(len(known.covariance)), known.covariance)
    drive, (electronics, fixed, *weights) = known.drive, vector
    moved = np.array(weights[:-1]).reshape(5, -1)
    names = ("torque", "copper", "switching", "eddy", "hysteresis")
    changed = {name: getattr(drive, name) + more for name, more in zip(names, moved, strict=True)}
    drive = replace(drive, fixed=drive.fixed + fixed, returned=drive.returned + weights[-1], **changed)
    brakes = known.brakes + fixed - electronics
    return replace(known, drive=drive, electronics=known.electronics + electronics, brakes=brakes)


@pytest.mark.slow
def test_parameters_reach_the_groups_as_draws_of_them_do(arm_and_known, stretch):
    arm, known = arm_and_known
    small = replace(known, covariance=known.covariance / 100)  # linear about what was found
    rng = np.random.default_rng(4)
    level = at_campaign(small)
    rows = [list(task_energy(arm, drawn(small, rng), stretch, level).groups.values()) for _ in range(DRAWS)]
    slope = group_slopes(small, level, features(arm, stretch.torque, stretch.velocity), stretch.step)
    slope[-1] = -slope[:-1].sum(axis=0)
    stated = slope @ small.covariance @ slope.T
    seen = np.cov(np.array(rows).T)
    spread = np.sqrt(np.diag(seen))
    taken = spread > 1e-6
    assert [name for name, there in zip(GROUPS, taken, strict=True) if not there] == ["stored"]
    assert np.sqrt(np.diag(stated))[taken] == pytest.approx(spread[taken], rel=0.06)
    both = np.outer(spread, spread)[np.ix_(taken, taken)]
    assert stated[np.ix_(taken, taken)] / both == pytest.approx(seen[np.ix_(taken, taken)] / both, abs=0.06)


def test_errors_of_all_groups_together_are_those_of_the_measured_total(arm_and_known, stretch):
    """Not the root of the squares: what one group has too much another has too little."""
    arm, known = arm_and_known
    energy = task_energy(arm, known, stretch, at_campaign(known), edge=2.0, meter=0.001)
    of_total = np.linalg.norm([2.0, 0.003 * energy.total, 0.001 * energy.total])
    assert np.sqrt(energy.covariance.sum()) == pytest.approx(of_total, rel=1e-9)
    said = deviations(energy.covariance)
    assert said["unexplained"] == energy.uncertainty
    apart = np.linalg.norm([said[name] for name in GROUPS])
    assert apart > 1.05 * of_total
    explained = energy.covariance[:-1, :-1].sum() + np.linalg.norm([2.0, 0.003 * energy.total]) ** 2
    assert energy.uncertainty**2 == pytest.approx(explained, rel=0.02)


def test_an_energy_json_from_before_is_refused_with_what_to_do(measured, outcome, tmp_path):
    found = outcome.findings.as_json()
    arm, path = Arm.load(measured[1]), tmp_path / "energy.json"
    path.write_text(json.dumps(found | {"covariance": [row[:-1] for row in found["covariance"][:-1]]}))
    with pytest.raises(ModelError, match="covariance of 31 parameters, expected 32"):
        load_known(path, arm)


@pytest.mark.parametrize(("drift", "now", "braked"), [(0, 0, True), (4, 4, True), (4, 0, False), (-4, -4, True)])
def test_brakes_are_no_drift_of_the_electronics_and_drift_is_no_brakes(arm_and_known, drift, now, braked):
    """``drift`` W at the rests before and ``now``, of an arm whose brakes draw 5 W."""
    arm, known = arm_and_known
    known, still = replace(known, brakes=5.0), np.zeros(arm.joints)
    level = replace(at_campaign(known), drift=float(drift))
    assert (followed(level, arm, known, still, known.drive.fixed + now - 5.0 * braked) is level) == braked
