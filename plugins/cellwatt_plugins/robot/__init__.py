"""What all science of robots shares: the description in ``robot.yaml`` and rigid-body dynamics through Pinocchio."""

from cellwatt_plugins.robot.description import Joint, RobotDescription, load_robot
from cellwatt_plugins.robot.rigid_body import RigidBody

__all__ = ["Joint", "RigidBody", "RobotDescription", "load_robot"]
