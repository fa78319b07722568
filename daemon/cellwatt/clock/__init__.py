"""Maps device time to the cell's time, with a guaranteed bound."""

from cellwatt.clock.model import ClockModel, ClockState
from cellwatt.clock.polled import middle, unwrapped

__all__ = ["ClockModel", "ClockState", "middle", "unwrapped"]
