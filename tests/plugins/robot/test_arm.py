import numpy as np
import pytest
import yaml

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import Arm, Joint, RobotDescription
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
    path = truth.write(tmp_path_factory.mktemp("planar"))
    return RobotDescription(robot="planar", urdf=path, joints=(SHOULDER, ELBOW), standby_power=40.0)


def test_limits_are_the_descriptions_before_the_urdfs(robot):
    shoulder = SHOULDER.model_copy(update={"upper_limit": 0.5, "velocity_limit": 1.25})
    limited = Arm.of(robot.model_copy(update={"joints": (shoulder, ELBOW)}))
    own = limited.body.limits
    np.testing.assert_array_equal(limited.limits, [[own[0, 0], 0.5], own[1]])
    assert limited.velocity_limits.tolist() == [1.25, limited.body.velocity_limits[1]]
    none = Arm.of(robot.model_copy(update={"joints": (SHOULDER.model_copy(update={"lower_limit": 9.0}), ELBOW)}))
    with pytest.raises(ConfigError, match=r"urdf: shoulder has no range: write lower_limit and upper_limit, in rad"):
        none.finite_limits()


def test_what_every_joint_needs_is_told(tmp_path):
    truth.write(tmp_path)
    joints = [joint.model_dump(exclude_defaults=True) for joint in (SHOULDER, ELBOW)]
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump({"robot": "planar", "urdf": "arm.urdf", "joints": joints}))
    assert Arm.load(tmp_path, needs=("coulomb_friction",)).name == "planar"
    with pytest.raises(ConfigError, match=r"yaml:8:3: joints\[1\]\.torque_constant: elbow has no torque_constant: add"):
        Arm.load(str(tmp_path / "robot.yaml"), needs=("torque_constant",))
