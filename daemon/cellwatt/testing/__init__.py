"""The kits: conformance suites that any driver and any outlet runs, in this repository or outside it.

``DriverConformance`` and ``OutletConformance`` need pytest (``pip install 'cellwatt[testing]'``); all else does not.
"""

from __future__ import annotations

from importlib import import_module
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


_SUITES = {"DriverConformance": "cellwatt.testing.suite", "OutletConformance": "cellwatt.testing.outlet_suite"}


def __getattr__(name: str) -> Any:
    """Import pytest only with a suite."""
    if name not in _SUITES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_SUITES[name]), name)
