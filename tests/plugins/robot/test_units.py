import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import Arm, unit_at
from tests.plugins.robot import scara


@pytest.mark.parametrize(
    ("unit", "along"),
    [("rad", "m"), ("Nm s/rad", "N s/m"), ("kg*m^2", "kg"), ("W", "W"), ("N*m*s^2/rad^2", "N*s^2/m^2")],
)
def test_units_of_a_slide(unit, along):
    assert unit_at("prismatic", unit) == along
    assert unit_at("revolute", unit) == unit


def test_kinds_are_the_urdfs(tmp_path):
    arm = Arm.load(scara.write(tmp_path))
    assert [joint.kind for joint in arm.description.joints] == ["revolute", "revolute", "prismatic"]
    assert [arm.description.unit(i, "Nm s/rad") for i in range(3)] == ["Nm s/rad", "Nm s/rad", "N s/m"]
    _, *motion = scara.motion()
    np.testing.assert_allclose(arm.torque(*motion), scara.torque(*motion), atol=1e-3)


def test_a_kind_that_the_urdf_contradicts_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="joint axis_1 is revolute, the robot's description says otherwise"):
        Arm.load(scara.write(tmp_path, kind="prismatic"))
