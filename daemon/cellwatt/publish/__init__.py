"""Publication over Zenoh."""

from cellwatt.publish.sink import PublishSettings, ZenohSettings, ZenohSink

__all__ = ["PublishSettings", "ZenohSettings", "ZenohSink"]
