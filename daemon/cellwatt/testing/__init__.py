"""The kits: conformance suites that any driver and any outlet runs, in this repository or outside it.

``DriverConformance`` and ``OutletConformance`` need pytest (``pip install 'cellwatt[testing]'``); all else does not.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.outlet_rig import OutletRig
from cellwatt.testing.recorded_cell import RecordedCell
from cellwatt.testing.rig import NotConformingError, Rig

if TYPE_CHECKING:
    from cellwatt.testing.outlet_suite import OutletConformance
    from cellwatt.testing.suite import DriverConformance

__all__ = [
    "CollectingInlet",
    "DriverConformance",
    "EmulatedDevice",
    "NotConformingError",
    "OutletConformance",
    "OutletRig",
    "RecordedCell",
    "Rig",
]


def __getattr__(name: str) -> Any:
    """Load pytest only with a suite."""
    if name == "OutletConformance":
        from cellwatt.testing.outlet_suite import OutletConformance

        return OutletConformance
    if name == "DriverConformance":
        from cellwatt.testing.suite import DriverConformance

        return DriverConformance
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
