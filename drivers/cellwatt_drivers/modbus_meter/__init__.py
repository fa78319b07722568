"""Energy meters on Modbus TCP and RTU, described by YAML maps."""

from cellwatt_drivers.modbus_meter.driver import ModbusMeterDriver, ModbusMeterSettings

__all__ = ["ModbusMeterDriver", "ModbusMeterSettings"]
