"""The arm without a description: what its weights can hold, and what it learns."""

import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.api import learn_from
from cellwatt_plugins.faults.cycles.arm import Motion
from cellwatt_plugins.faults.cycles.bare_arm import BareArm
from cellwatt_plugins.faults.cycles.known import learn_known, restored, stored
from cellwatt_plugins.faults.cycles.load import load_of
from tests.plugins.faults.paper.irb1200 import POLISHING_WITHOUT_RESTS, Run
from tests.plugins.faults.paper.irb1200 import run as run_without_rests
from tests.plugins.faults.plant import frames


@pytest.fixture(scope="module")
def bare(healthy):
    return learn_known(healthy, BareArm(np.ones(healthy.joints)))


def test_its_torques_are_the_slopes_of_an_energy():
    arm, some, step = BareArm(np.array([1.0, 1.0, 0.2, 1.0])), np.random.default_rng(0), 1e-6
    q, weights = some.uniform(-1.0, 1.0, (5, 4)), some.normal(size=40)
    torque = arm.regressor(q, q, q) @ weights
    turned = [arm.regressor(q + step * unit, q, q) @ weights for unit in np.eye(4)]
    slopes = np.stack([(each - torque) / step for each in turned], axis=2)
    assert np.abs(slopes).max() > 1.0
    assert slopes == pytest.approx(slopes.transpose(0, 2, 1), abs=1e-4)


def test_it_fits_the_power_of_the_healthy_cycles(bare):
    for pattern in bare.patterns:
        motion = Motion.of(bare.arm.body, pattern.position, *pattern.rates)
        left = pattern.power - load_of(bare.arm.body, bare.arm.parameters, motion).power
        assert np.std(left) < 0.15 * np.std(pattern.power)


def test_it_is_fitted_again_from_the_reference(bare):
    arm = BareArm(np.ones(bare.arm.body.joints))
    model, cycles = stored(bare, arm)
    assert model.joints == ()
    again = restored(model, cycles, arm)
    assert again.arm.parameters.packed() == pytest.approx(bare.arm.parameters.packed())
    assert again.arm.covariance == pytest.approx(bare.arm.covariance)


def test_of_a_motion_without_rests_only_intervals_are_learned():
    told = run_without_rests(Run(POLISHING_WITHOUT_RESTS, 6, 1.0, rate=50.0, lead=1.0, seed=1))
    learned = learn_from(frames(told.q, told.power), None, "arm", "supply.power")
    assert (learned.reference.cycles, len(learned.reference.tasks)) == ((), 1)
    assert learned.note is not None and learned.note.startswith("intervals only, no whole cycles: no task was seen")


def test_of_one_cycle_alone_nothing_is_learned():
    told = run_without_rests(Run(POLISHING_WITHOUT_RESTS, 1, 1.0, rate=50.0, lead=1.0, seed=1))
    with pytest.raises(ModelError, match="two healthy cycles or more must follow each other"):
        learn_from(frames(told.q, told.power), None, "arm", "supply.power")
