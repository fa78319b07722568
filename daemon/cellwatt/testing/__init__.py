"""The kits: conformance suites that any driver and any outlet runs, in this repository or outside it."""

from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.outlet_rig import OutletRig
from cellwatt.testing.outlet_suite import OutletConformance
from cellwatt.testing.recorded_cell import RecordedCell
from cellwatt.testing.rig import NotConformingError, Rig
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
