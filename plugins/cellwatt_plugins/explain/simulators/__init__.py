"""Simulators that people have: run on a motion, and given back what their files leave out."""

from cellwatt_plugins.explain.simulators.mujoco import Simulator, load_simulator

__all__ = ["Simulator", "load_simulator"]
