from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.nuisance import supply_nuisance, torque_nuisance
from tests.plugins.explain import plant


@pytest.fixture(scope="module")
def states(arm):
    return plant.states(arm, seconds=6.0)


@pytest.mark.parametrize(
    ("kind", "name"),
    [("coulomb", "coulomb_friction"), ("viscous", "viscous_friction"), ("rotor", "rotor_inertia")],
)
@pytest.mark.parametrize("joint", [1, 2, 3])
def test_columns_of_friction_and_rotor_are_what_another_arm_needs_more(states, kind, name, joint):
    values = list(getattr(plant.NOMINAL, kind))
    values[joint - 1] += 0.25
    other = replace(plant.NOMINAL, **{kind: tuple(values)})
    difference = plant.motors(other, states.q, states.qd, states.qdd) - states.nominal
    (block,) = (b for b in torque_nuisance([states]) if (b.name, b.joint) == (name, joint - 1))
    assert block.channel == joint - 1
    assert np.allclose(block.times(np.array([0.25]), plant.JOINTS), difference, atol=1e-9)


def test_columns_of_a_link_are_what_a_heavier_one_needs_more(states):
    new = plant.loaded(plant.NOMINAL, 0.7, 0.3)
    more = np.subtract(plant.inertial(new, 1), plant.inertial(plant.NOMINAL, 1))
    block = torque_nuisance([states])[2]
    difference = plant.links(new, states.q, states.qd, states.qdd) - states.rigid
    assert np.allclose(block.times(more, plant.JOINTS), difference, atol=1e-9)


def test_what_a_simulation_has_beyond_the_description_may_be_off(states):
    """Iron loss and a ripple of joint 2 that robot.yaml has no numbers for, each within the tolerance of its kind."""
    ripple, iron = np.zeros_like(states.q), 3.0 * np.sum(np.abs(states.qd), axis=1)
    ripple[:, 1] = 2.0 * np.sin(20 * states.q[:, 1])
    told = replace(states, beyond=ripple, beyond_power=iron)
    *links, torque = torque_nuisance([told])
    assert len(links) == len(torque_nuisance([states])) and torque.channel == 1
    assert np.allclose(torque.times(np.ones(1), plant.JOINTS), ripple)
    *supply, power = supply_nuisance([told])
    assert len(supply) == len(supply_nuisance([states])) and np.allclose(power.columns[:, 0], iron)
    tolerances = states.robot.tolerances
    assert torque.prior.deviations == pytest.approx(tolerances.friction)
    assert power.prior.deviations == pytest.approx(tolerances.supply)


def test_what_the_simulation_leaves_out_is_not_retuned(tmp_path):
    arm = plant.load(plant.write_robot(tmp_path, coulomb_friction=0.0, rotor_inertia=0.0))
    blocks = torque_nuisance([plant.states(arm, seconds=3.0)])
    assert len(blocks) == 2 * plant.JOINTS


def test_tolerances_are_the_spread_of_the_priors(tmp_path):
    tolerances = {"friction": 0.2, "rotor_inertia": 0.03, "link": 0.04, "supply": 0.07}
    arm = plant.load(plant.write_robot(tmp_path, tolerances=tolerances))
    states = plant.states(arm, seconds=3.0)
    blocks = torque_nuisance([states])
    spread = [np.sqrt(b.prior.covariance[0, 0]) for b in blocks[plant.JOINTS :]]
    expected = [*(0.2 * np.array(plant.NOMINAL.coulomb)), *(0.2 * np.array(plant.NOMINAL.viscous))]
    assert spread == pytest.approx([*expected, *(0.03 * np.array(plant.NOMINAL.rotor))])
    supply = [np.sqrt(b.prior.covariance[0, 0]) for b in supply_nuisance([states])]
    assert supply == pytest.approx([0.07 * plant.NOMINAL.standby, 0.07, 0.07, 0.07])
