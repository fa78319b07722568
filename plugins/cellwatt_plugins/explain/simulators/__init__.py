"""The user's simulators: run on a motion, and mended with the physics that their files lack."""

from cellwatt_plugins.explain.simulators.mujoco import Simulator, load_simulator

__all__ = ["Simulator", "load_simulator"]
