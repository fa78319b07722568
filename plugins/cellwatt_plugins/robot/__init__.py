"""The arm, shared by all plugins: its description (``robot.yaml``), rigid body (URDF), drives, friction and effects."""

from cellwatt_plugins.robot.arm import Arm
from cellwatt_plugins.robot.body import Body
from cellwatt_plugins.robot.description import Joint, RobotDescription, load_robot
from cellwatt_plugins.robot.units import Kind, unit_at

__all__ = ["Arm", "Body", "Joint", "Kind", "RobotDescription", "load_robot", "unit_at"]
