from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.arm import Motion, supply_power
from cellwatt_plugins.faults.cycles.effects import Effect, joint_effects
from cellwatt_plugins.faults.cycles.load import load_of
from cellwatt_plugins.faults.cycles.weigh import bend, weigh
from cellwatt_plugins.robot.drive import drive_power
from cellwatt_plugins.robot.regression import Whitener


@pytest.fixture(scope="module")
def load(known):
    pattern = known.patterns[0]
    return load_of(known.arm.body, known.arm.parameters, Motion(pattern.position, *pattern.rates))


def effect(known, load, what, joint):
    return next(e for e in joint_effects(known.arm, load, joint) if e.what == what)


def in_full(known, load, joint, extra):
    """Power (N,) W that a torque (N,) more at a joint takes, by the whole equations."""
    torque = load.torque.copy()
    torque[:, joint] += extra
    p = known.arm.parameters
    return supply_power(p, drive_power(p.copper, torque, load.motion.qd)) - load.power


@pytest.mark.parametrize("what", ["friction", "spring"])
@pytest.mark.parametrize("size", [0.1, 3.0])
def test_power_of_a_torque_is_that_of_the_whole_equations(known, load, what, size):
    it = effect(known, load, what, 0)
    sizes = np.array([size, 0.5 * size])
    bent = bend(known.arm.parameters, load, [it], [sizes])
    expected = in_full(known, load, 0, it.torque @ sizes)
    assert np.abs(expected).max() > 1.0
    assert bent.power == pytest.approx(expected, abs=1e-6)
    step = 1e-5 * np.array([1.0, 0.0])
    more = bend(known.arm.parameters, load, [it], [sizes + step]).power
    steady = np.sign(load.drives.sum(axis=1)) == np.sign(load.drives.sum(axis=1) + bent.power)
    assert ((more - bent.power) / 1e-5)[steady] == pytest.approx(bent.slope[steady, 0], rel=1e-2, abs=1e-2)


def test_a_load_of_the_supply_is_beside_what_the_drives_take_and_return(known):
    parameters, pattern = replace(known.arm.parameters, regenerate=0.1), known.patterns[0]
    load = load_of(known.arm.body, parameters, Motion(pattern.position, *pattern.rates))
    later = (pattern.time > 2.0).astype(float)
    bent = bend(parameters, load, [Effect("switched", None, later[:, None], at_supply=True)], [np.array([-8.0])])
    assert np.ptp(load.gain) > 0.5
    assert bent.power == pytest.approx(-8.0 * later)
    assert bent.slope[:, 0] == pytest.approx(later)


def test_the_size_of_a_large_fault_is_found(known, load, monkeypatch):
    """Along the slope of power without a fault it is far off."""
    it = effect(known, load, "spring", 2)
    truth = np.array([4.0, -1.0])
    residual = in_full(known, load, 2, it.torque @ truth) + np.random.default_rng(2).normal(0.0, 1.0, len(load.power))
    white = Whitener.of(np.ones(len(residual)), np.empty((len(residual), 0)))
    found = weigh(known.arm.parameters, load, white, white(residual), [it])
    monkeypatch.setattr("cellwatt_plugins.faults.cycles.weigh.ROUNDS", 1)
    straight = weigh(known.arm.parameters, load, white, white(residual), [it])
    assert found.sizes[0] == pytest.approx(truth, rel=0.03)
    assert abs(straight.sizes[0][0] / truth[0] - 1.0) > 0.1
    assert found.misfit < 1.3 * len(residual) < straight.misfit
