"""Yaskawa robots over the High-Speed Ethernet Server."""

from cellwatt_drivers.yaskawa.driver import YaskawaDriver, YaskawaSettings

__all__ = ["YaskawaDriver", "YaskawaSettings"]
