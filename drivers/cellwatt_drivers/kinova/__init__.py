"""Kinova Gen3 arms over Modbus TCP, or over Kortex with the vendor's library."""

from cellwatt_drivers.kinova.driver import KinovaDriver, KinovaSettings

__all__ = ["KinovaDriver", "KinovaSettings"]
