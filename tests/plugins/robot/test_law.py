import numpy as np
import pytest

from cellwatt_plugins.robot import Joint, RigidBody, RobotDescription
from cellwatt_plugins.robot.drive import copper_loss, nominal_power
from cellwatt_plugins.robot.law import column, nominal_torque
from tests.plugins.robot import planar_arm as truth

SHOULDER = Joint(
    name="shoulder",
    torque_constant=9.0,
    rotor_inertia=1.5,
    coulomb_friction=6.0,
    viscous_friction=4.0,
    winding_resistance=0.8,
)
ELBOW = Joint(name="elbow", rotor_inertia=0.4, coulomb_friction=2.0, viscous_friction=1.0, winding_resistance=0.5)


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    path = tmp_path_factory.mktemp("planar") / "arm.urdf"
    path.write_text(truth.urdf())
    return RobotDescription(robot="planar", urdf=path, joints=(SHOULDER, ELBOW), standby_power=40.0)


@pytest.fixture(scope="module")
def body(robot):
    return RigidBody(robot.urdf, ("shoulder", "elbow"))


def test_columns_follow_the_joints(robot):
    np.testing.assert_array_equal(column(robot, "torque_constant"), [9.0, 0.0])
    np.testing.assert_array_equal(column(robot, "rotor_inertia"), [1.5, 0.4])


def test_torque_is_rigid_body_rotor_and_friction(robot, body):
    q, qd, qdd = truth.motion(seed=6)
    expected = (
        truth.torque(q, qd, qdd) + [1.5, 0.4] * qdd + [6.0, 2.0] * np.tanh(qd / 0.004) + np.array([4.0, 1.0]) * qd
    )
    np.testing.assert_allclose(nominal_torque(robot, body, q, qd, qdd), expected, atol=1e-9)


def test_friction_turns_over_at_rest(robot, body):
    q = np.zeros((3, 2))
    qd = np.array([[-0.004, 0.004], [0.0, 0.0], [0.004, -0.004]])
    friction = nominal_torque(robot, body, q, qd, q) - nominal_torque(robot, body, q, q, q)
    tanh1 = 0.7615941559557649
    expected = np.array([[-6 * tanh1 - 0.016, 2 * tanh1 + 0.004], [0, 0], [6 * tanh1 + 0.016, -2 * tanh1 - 0.004]])
    np.testing.assert_allclose(friction, expected, atol=1e-4)


def test_copper_loss_is_current_squared_times_resistance(robot):
    loss = copper_loss(robot, np.array([[18.0, 7.0], [-9.0, 0.0]]))
    np.testing.assert_allclose(loss, [[4 * 0.8, 0.0], [0.8, 0.0]])


def test_power_is_standby_mechanical_and_copper(robot):
    power = nominal_power(robot, np.array([[18.0, 7.0], [-9.0, 2.0]]), np.array([[0.5, -1.0], [2.0, 0.0]]))
    np.testing.assert_allclose(power, [40 + 9.0 - 7.0 + 3.2, 40 - 18.0 + 0.8])
