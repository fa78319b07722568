"""The plant that the tests lean on: its torques do the work that its energy gains, and it writes what it knows."""

import numpy as np
import pytest
from energy.arms import Case, make_arm
from energy.chain import torques

from cellwatt_plugins.robot import Body


def test_work_is_what_lifting_took():
    truth = make_arm(Case("a", 3))
    time = np.linspace(0, 1, 2001)
    s = 10 * time**3 - 15 * time**4 + 6 * time**5
    q = np.array([0.1, -0.7, 0.9, 0.2, 0.4, 0.0]) + s[:, None] * np.array([0.8, 0.4, -0.6, 0.5, 0.3, 0.7])
    qd = np.gradient(q, time, axis=0)
    qdd = np.gradient(qd, time, axis=0)
    moving = torques(truth.links, q, qd, qdd, 5.0, truth.tool)
    still = torques(truth.links, q, 0 * qd, 0 * qd, 5.0, truth.tool)
    # It begins and ends at rest: kinetic energy comes back, potential energy does not depend on the way.
    assert np.trapezoid((moving * qd).sum(axis=1), time) == pytest.approx(
        np.trapezoid((still * qd).sum(axis=1), time), abs=0.02
    )


def test_its_urdf_is_the_arm_that_it_moves(measured):
    case, folder, _ = measured
    body = Body(folder / "robot.urdf", tuple(f"joint_{i + 1}" for i in range(case.joints)))
    rng = np.random.default_rng(1)
    q, qd, qdd = rng.normal(0, 1, (3, 20, case.joints))
    assert torques(make_arm(case).known, q, qd, qdd) == pytest.approx(body.inverse_dynamics(q, qd, qdd), abs=1e-6)


def test_its_energies_add_up(measured):
    for run in measured[2]["runs"]:
        parts = ("electronics", "brakes", "mechanical_losses", "electrical_losses", "regeneration")
        assert sum(run[part] for part in parts) == pytest.approx(run["total"], rel=1e-9)
