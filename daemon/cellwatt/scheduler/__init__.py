"""Independent parts of long work, done one after the other, or in processes of this machine."""

from cellwatt.scheduler.spread import scheduled, spread

__all__ = ["scheduled", "spread"]
