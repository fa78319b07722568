"""The driver kit: a conformance suite that any driver runs, in this repository or outside it.

``DriverConformance`` needs pytest (``pip install 'cellwatt[testing]'``); all else here does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import NotConformingError, Rig

if TYPE_CHECKING:
    from cellwatt.testing.suite import DriverConformance

__all__ = ["CollectingInlet", "DriverConformance", "EmulatedDevice", "NotConformingError", "Rig"]


def __getattr__(name: str) -> Any:
    """Load pytest only with the suite."""
    if name == "DriverConformance":
        from cellwatt.testing.suite import DriverConformance

        return DriverConformance
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
