import numpy as np
import pytest

from tests.plugins.explain import plant


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    return plant.states(plant.load(plant.write_robot(tmp_path_factory.mktemp("plant"))), seconds=6.0)


def test_what_a_joint_feels_alone_is_the_diagonal_of_the_mass_matrix(states):
    expected = np.diagonal(plant.inertia(plant.NOMINAL, states.q), axis1=1, axis2=2)
    assert np.allclose(states.own_inertia, expected, atol=1e-10)


def test_the_nominal_torque_is_that_of_the_nominal_arm(states):
    expected = plant.motors(plant.NOMINAL, states.q, states.qd, states.qdd)
    assert np.allclose(states.nominal, expected, atol=1e-9)
    assert np.allclose(states.rigid + np.array(plant.NOMINAL.rotor) * states.qdd + states.friction, expected, atol=1e-9)


def test_the_arm_moves_where_a_joint_does(states):
    fast = np.max(np.abs(states.qd), axis=1)
    assert states.moving[fast > 0.02].all()
    assert not states.moving[fast < 0.001].any()
