import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import Body
from tests.plugins.robot import planar_arm as truth


def body_of(folder, joints=("shoulder", "elbow"), **arm):
    return Body(truth.write(folder, **arm), joints)


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    return body_of(tmp_path_factory.mktemp("planar"))


def test_inverse_dynamics_are_the_textbooks(body):
    q, qd, qdd = truth.motion()
    assert body.joints == 2
    np.testing.assert_allclose(body.inverse_dynamics(q, qd, qdd), truth.torque(q, qd, qdd), atol=1e-10)


def test_each_part_alone(body):
    q, qd, _ = truth.motion(seed=1)
    rest = np.zeros_like(q)
    np.testing.assert_allclose(body.gravity(q), truth.gravity(q), atol=1e-10)
    moved = body.inverse_dynamics(q, qd, rest) - truth.gravity(q)
    np.testing.assert_allclose(moved, truth.coriolis(q, qd), atol=1e-10)
    np.testing.assert_allclose(body.mass_matrix(q), truth.mass_matrix(q), atol=1e-10)


def test_energy_rises_by_the_work_of_the_torques(body):
    """Both links driven by the textbook's torques: dE/dt = qd · torque."""
    time = np.linspace(0, 2, 4001)[:, None]
    q, qd, qdd = 0.5 * np.sin(2 * time + [0, 1]), np.cos(2 * time + [0, 1]), -2 * np.sin(2 * time + [0, 1])
    work = np.trapezoid(np.sum(qd * truth.torque(q, qd, qdd), axis=1), time[:, 0])
    first, last = body.energy(q[[0, -1]], qd[[0, -1]])
    assert last - first == pytest.approx(work, abs=1e-4)


def test_frames_and_axes_are_those_of_the_drawing(body):
    """The elbow is at the end of the first link; positive angles lower both, about y."""
    q = np.array([[0.0, 0.0], [0.3, -0.8]])
    frames = body.forward(q)
    tips = truth.L1 * np.column_stack([np.cos(q[:, 0]), np.zeros(2), -np.sin(q[:, 0])])
    np.testing.assert_allclose(frames[:, 1, :3, 3] - frames[:, 0, :3, 3], tips, atol=1e-12)
    np.testing.assert_allclose(frames[1, 1, :3, :3] @ body.axes[1], [0, 1, 0], atol=1e-12)
    assert body.turns.all()
    assert body.gravity_field.tolist() == [0.0, 0.0, -truth.G]


def test_parameters_are_mass_first_moment_and_inertia_about_the_joint(body):
    m, mx, my, mz, xx, xy, yy, xz, yz, zz = body.parameters()[:10]
    assert m == truth.M1
    assert (mx, my, mz) == pytest.approx((truth.M1 * truth.C1, truth.M1 * 0.05, 0))
    assert yy == pytest.approx(truth.I1 + truth.M1 * truth.C1**2)
    assert xx == pytest.approx(0.02 + truth.M1 * 0.05**2)
    assert zz == pytest.approx(0.03 + truth.M1 * (truth.C1**2 + 0.05**2))
    assert (xy, xz, yz) == pytest.approx((-truth.M1 * truth.C1 * 0.05, 0, 0))


def test_joints_not_named_are_fixed(tmp_path):
    q, qd, qdd = truth.motion(seed=5)
    with_gripper = body_of(tmp_path, gripper=True)
    assert with_gripper.joints == 2
    np.testing.assert_allclose(with_gripper.inverse_dynamics(q, qd, qdd), truth.torque(q, qd, qdd), atol=1e-10)


@pytest.mark.parametrize(
    ("joints", "arm", "message"),
    [
        (("shoulder", "wrist"), {}, "no moving joint wrist; there are shoulder, elbow"),
        (("elbow", "shoulder"), {}, "come in the order shoulder, elbow, the description has elbow, shoulder"),
        (("shoulder", "elbow"), {"kind": "floating"}, "each with one angle"),
    ],
)
def test_what_does_not_fit_is_said(tmp_path, joints, arm, message):
    with pytest.raises(ConfigError) as caught:
        body_of(tmp_path, joints, **arm)
    assert message in str(caught.value)
    assert str(tmp_path / "arm.urdf") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_limit_without_effort_and_velocity_is_a_range(tmp_path):
    (tmp_path / "arm.urdf").write_text(truth.urdf().replace(' effort="100" velocity="3"', ""))
    body = Body(tmp_path / "arm.urdf", ("shoulder", "elbow"))
    assert body.limits.tolist() == [[-3, 3], [-3, 3]]
    assert body.velocity_limits.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no xml", "cannot be read as a URDF"),
        ("<robot name='x'/>", "cannot be read as a URDF"),
        (truth.urdf().replace("5.2", "${mass}"), "link 'upper' is xacro: convert it first"),
        (truth.urdf().replace('<link name="base"/>', '<include xmlns="http://www.ros.org/wiki/xacro"/>'), "is xacro"),
        (truth.urdf().replace("5.2", "5,2"), "could not convert string to float: '5,2'"),
        (truth.urdf().replace("5.2", "nan"), "link 'upper' has an inertia that is not finite"),
    ],
)
def test_what_is_no_urdf_is_said(tmp_path, text, message):
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(ConfigError, match=r"arm\.urdf: cannot be read as a URDF: ") as caught:
        Body(tmp_path / "arm.urdf", ("shoulder", "elbow"))
    assert message in str(caught.value)
