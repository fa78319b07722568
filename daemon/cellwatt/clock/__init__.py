"""The cell's time of what devices sampled, with a bound that holds."""

from cellwatt.clock.model import ClockModel, ClockState
from cellwatt.clock.polled import middle

__all__ = ["ClockModel", "ClockState", "middle"]
