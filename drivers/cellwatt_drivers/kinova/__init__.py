"""Kinova Gen3 arms over Modbus TCP."""

from cellwatt_drivers.kinova.driver import KinovaDriver, KinovaSettings

__all__ = ["KinovaDriver", "KinovaSettings"]
