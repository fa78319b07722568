"""Splits a robot's energy into five consumer groups, from a power analyzer and the robot's own signals (ECDP)."""
