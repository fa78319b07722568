import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.arm import Motion
from cellwatt_plugins.faults.cycles.load import load_of
from tests.plugins.faults.cycles.four_joints import Cycle, run


def test_it_foretells_a_task_that_it_never_saw(known):
    unseen = run([Cycle("C")], seed=6, noise=0.0)
    v = np.gradient(unseen.position, 0.01, axis=0)
    motion = Motion(unseen.position, v, np.gradient(v, 0.01, axis=0))
    error = load_of(known.arm.body, known.arm.parameters, motion).power - unseen.power
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.ptp(unseen.power)


def test_slope_is_the_derivative_of_power(known):
    arm, random = known.arm, np.random.default_rng(1)
    motion = Motion(*(random.normal(size=(20, 4)) for _ in range(3)))
    load = load_of(arm.body, arm.parameters, motion)
    packed = arm.parameters.packed()
    direction = random.normal(size=len(packed)) * np.maximum(np.abs(packed), 0.01)
    ends = [load_of(arm.body, arm.parameters.unpacked(packed + s * direction, 4), motion).power for s in (1e-5, -1e-5)]
    assert load.slope(arm.parameters) @ direction == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4, abs=1e-4)
