"""Where a robot's energy goes: five consumer groups from an analyzer and the robot's own signals (ECDP)."""
