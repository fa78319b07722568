"""Publication over Zenoh.

The outlet itself is imported on first use: other outlets and their processes need only keys, marks and messages.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwatt.outlets.zenoh.outlet import PublishSettings, ZenohOutlet, ZenohSettings

__all__ = ["PublishSettings", "ZenohOutlet", "ZenohSettings"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("cellwatt.outlets.zenoh.outlet"), name)
