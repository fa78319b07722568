"""Sensors on a CAN bus, described by a DBC file and a YAML map."""

from cellwatt_drivers.can_sensor.driver import CanSensorDriver, CanSensorSettings

__all__ = ["CanSensorDriver", "CanSensorSettings"]
