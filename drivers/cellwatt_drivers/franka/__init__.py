"""Franka robots over the Franka Control Interface."""

from cellwatt_drivers.franka.driver import FrankaDriver

__all__ = ["FrankaDriver"]
