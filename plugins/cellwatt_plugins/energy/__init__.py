"""Split a robot's energy into five consumer groups, from an analyzer and the robot's own signals (ECDP)."""
