"""The plain regression predicts friction of a made arm on motion that it did not see."""

import numpy as np
import pytest
from real.describe import Link, chain, nothing, write_robot
from real.identify import BAND, low_pass
from real.recording import Recording
from real.regression import Grid, predicted

from cellwatt_plugins.robot import Arm

JOINTS = ("one", "two")
LINKS = tuple(Link(mass, (0.2, 0.01, 0.02), (0.1, 0.0, 0.0, 0.2, 0.0, 0.2)) for mass in (6.0, 2.0))
FRAMES = ((0.0, 0.0, 0.3), (0.0, np.pi / 2, 0.0))
COULOMB, VISCOUS = np.array([5.0, 3.0]), np.array([4.0, 2.0])


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    return Arm.load(write_robot(folder, "arm", JOINTS, chain("arm", JOINTS, FRAMES, LINKS), nothing(2), 100.0))


def recorded(arm: Arm, seed: int, seconds: int) -> Recording:
    """Sines at 100 Hz with friction that the description lacks."""
    rng = np.random.default_rng(seed)
    time = np.arange(100 * seconds) / 100
    turn = np.einsum("fj,t->ftj", rate := rng.uniform(0.5, 2.0, (3, 2)), time) + rng.uniform(0, 6, (3, 1, 2))
    q, qd, qdd = (np.sum(0.3 * rate[:, None] ** k * np.real(1j**k * np.exp(1j * turn)), axis=0) for k in range(3))
    torque = arm.torque(q, qd, qdd) + COULOMB * np.tanh(qd / 0.004) + VISCOUS * qd
    return Recording(f"run_{seed}", time, q, qd, torque=torque + 0.05 * rng.standard_normal(torque.shape))


def test_friction_is_predicted_on_unseen_motion(arm):
    unseen = recorded(arm, 3, 6)
    torque, terms = predicted([recorded(arm, 1, 13), recorded(arm, 2, 9)], unseen, arm)
    grid = Grid.of(unseen, arm)
    left = (low_pass(grid.measured, BAND) - torque)[50:-50]
    assert np.sqrt(np.mean(left**2, axis=0)) == pytest.approx([0.0, 0.0], abs=0.15)
    assert all(chosen[:3] == ["coulomb", "viscous", "offset"] for chosen in terms)


def test_a_joint_without_torque_keeps_what_is_simulated(arm):
    seen, unseen = recorded(arm, 1, 16), recorded(arm, 3, 6)
    seen.torque[:, 1] = np.nan
    torque, terms = predicted([seen], unseen, arm)
    assert terms[1] == []
    assert np.array_equal(torque[:, 1], low_pass(Grid.of(unseen, arm).simulated, BAND)[:, 1])
