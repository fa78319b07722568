"""Independent parts of long work, done one after the other, in processes of this machine, or by dask workers."""

from cellwatt.scheduler.spread import scheduled, spread

__all__ = ["scheduled", "spread"]
