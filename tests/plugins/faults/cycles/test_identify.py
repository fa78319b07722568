import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.arm import Motion
from cellwatt_plugins.faults.cycles.load import load_of
from tests.plugins.faults.cycles.arm_of_points import TASK_C, Cycle, run


def power_of(arm, measured):
    v = np.gradient(measured.position, 0.01, axis=0)
    return load_of(arm.body, arm.parameters, Motion(measured.position, v, np.gradient(v, 0.01, axis=0))).power


def test_it_foretells_a_task_that_it_never_saw(known):
    assert len(TASK_C) == 5
    unseen = run([Cycle("C")], seed=6, noise=0.0)
    error = power_of(known.arm, unseen) - unseen.power
    assert np.sqrt(np.mean(error**2)) < 0.02 * np.ptp(unseen.power)


def test_slope_is_the_derivative_of_power(known):
    arm, random = known.arm, np.random.default_rng(1)
    motion = Motion(*(random.normal(size=(20, 4)) for _ in range(3)))
    load = load_of(arm.body, arm.parameters, motion)
    packed = arm.parameters.packed()
    direction = random.normal(size=len(packed)) * np.maximum(np.abs(packed), 0.01)
    ends = [load_of(arm.body, arm.parameters.unpacked(packed + s * direction, 4), motion).power for s in (1e-5, -1e-5)]
    assert load.slope(arm.parameters) @ direction == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4, abs=1e-4)
