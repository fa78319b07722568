"""Universal Robots arms over RTDE (TCP 30004)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwatt_drivers.ur.driver import UrDriver

__all__ = ["UrDriver"]


def __getattr__(name: str) -> Any:
    """Load the driver when it is asked for: the library's reader process imports this package without it."""
    if name == "UrDriver":
        from cellwatt_drivers.ur.driver import UrDriver

        return UrDriver
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
