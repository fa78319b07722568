"""The owner's preparation, on a made arm whose gains, friction and load are known."""

import numpy as np
import pytest
from real.calibrate import calibrated_gains
from real.describe import Link, chain
from real.identify import carried_mass, identify, links_of
from real.recording import Recording

from cellwatt_plugins.robot import Body

JOINTS = ("one", "two", "three")
LINKS = tuple(Link(mass, (0.2, 0.01, 0.02), (0.1, 0.0, 0.0, 0.2, 0.0, 0.2)) for mass in (6.0, 4.0, 2.0))
FRAMES = ((0.0, 0.0, 0.3), (0.0, np.pi / 2, 0.0), (0.5, 0.0, 0.0))
GAIN = np.array([12.0, 11.0, 9.0])
COULOMB, VISCOUS, ROTOR = np.array([5.0, 6.0, 3.0]), np.array([4.0, 5.0, 2.0]), np.array([1.5, 1.2, 0.5])
LOAD, PLACE = 2.5, np.array([0.35, 0.05, 0.1])


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.urdf"
    path.write_text(chain("arm", JOINTS, FRAMES, LINKS))
    return Body(path, JOINTS)


def recorded(body: Body, load: float, seed: int) -> Recording:
    """15 s of sines at 100 Hz, current from the arm's own law and the load's first moment and inertia."""
    rng = np.random.default_rng(seed)
    time = np.arange(1500) / 100
    rate, size = rng.uniform(0.3, 2.0, (5, 3)), rng.uniform(0.1, 0.4, (5, 3))
    turn = np.einsum("fj,t->ftj", rate, time) + rng.uniform(0, 6, (5, 1, 3))
    q, qd, qdd = (
        np.sum(size[:, None] * rate[:, None] ** k * np.real(1j**k * np.exp(1j * turn)), axis=0) for k in range(3)
    )
    x, y, z = PLACE
    inertia = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
    carried = body.regressor(q, qd, qdd)[:, :, -10:] @ (load * np.array([1.0, *PLACE, *inertia]))
    friction = COULOMB * np.tanh(qd / 0.004) + VISCOUS * qd
    torque = body.inverse_dynamics(q, qd, qdd) + ROTOR * qdd + friction + carried
    noise = 0.02 * rng.standard_normal(torque.shape)
    return Recording(f"run_{seed}", time, q, qd, current=torque / GAIN + noise)


@pytest.fixture(scope="module")
def runs(body):
    """Recordings without the load, and with it."""
    return [recorded(body, 0.0, 1), recorded(body, 0.0, 2)], [recorded(body, LOAD, 3)]


def test_a_known_mass_gives_the_gains_of_all_drives(body, runs):
    found = calibrated_gains(*runs, LOAD, body, GAIN * np.array([1.2, 0.9, 1.1]))
    assert found[1:] == pytest.approx(GAIN[1:], rel=0.02)
    assert found[0] == pytest.approx(GAIN[0], rel=0.05), "gravity does not load the first joint: inertia alone tells"


def test_a_plain_fit_is_off_by_as_much_as_the_gains(body, runs):
    assert carried_mass(*runs, body, GAIN) == pytest.approx(LOAD, rel=0.02)
    assert carried_mass(*runs, body, 1.1 * GAIN) == pytest.approx(1.1 * LOAD, rel=0.02)


def test_friction_is_identified(body, runs):
    known = identify(runs[0], body, GAIN, 100.0)
    assert known.drives.coulomb == pytest.approx(COULOMB, rel=0.05)
    assert known.drives.viscous == pytest.approx(VISCOUS, rel=0.05)


def test_links_become_real_bodies(body):
    parameters = body.parameters()
    parameters[4:10] = 0.0
    inertia = links_of(parameters)[0].inertia
    matrix = np.array([[inertia[0], inertia[1], inertia[2]], [inertia[1], inertia[3], inertia[4]],
                       [inertia[2], inertia[4], inertia[5]]])  # fmt: skip
    assert np.linalg.eigvalsh(matrix).min() > 0


def test_rests_at_both_ends_are_cut():
    time = np.arange(1000) / 100
    velocity = np.where((time > 2) & (time < 8), 0.5, 0.0)[:, None]
    kept = Recording("run", time, velocity, velocity, torque=velocity).moving()
    assert (kept.time[0], kept.time[-1]) == (pytest.approx(2.3, abs=0.02), pytest.approx(7.7, abs=0.02))
