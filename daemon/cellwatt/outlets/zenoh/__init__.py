"""Publication over Zenoh."""

from cellwatt.outlets.zenoh.outlet import PublishSettings, ZenohOutlet, ZenohSettings

__all__ = ["PublishSettings", "ZenohOutlet", "ZenohSettings"]
