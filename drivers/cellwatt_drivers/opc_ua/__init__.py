"""Controllers and robots with an OPC UA server: PLC tags and joints as channels."""

from cellwatt_drivers.opc_ua.driver import OpcUaDriver
from cellwatt_drivers.opc_ua.settings import OpcUaSettings

__all__ = ["OpcUaDriver", "OpcUaSettings"]
