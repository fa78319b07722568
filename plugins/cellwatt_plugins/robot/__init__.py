"""What all science of robots shares: an arm with its description (``robot.yaml``) and its rigid body (URDF)."""

from cellwatt_plugins.robot.arm import Arm
from cellwatt_plugins.robot.body import Body
from cellwatt_plugins.robot.description import Joint, RobotDescription, load_robot

__all__ = ["Arm", "Body", "Joint", "RobotDescription", "load_robot"]
