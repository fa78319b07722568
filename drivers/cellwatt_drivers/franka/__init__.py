"""Franka robots over the Franka Control Interface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cellwatt_drivers.franka.driver import FrankaDriver

__all__ = ["FrankaDriver"]


def __getattr__(name: str) -> Any:
    """Load the driver when it is asked for: the library's reader process imports this package without it."""
    if name == "FrankaDriver":
        from cellwatt_drivers.franka.driver import FrankaDriver

        return FrankaDriver
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
