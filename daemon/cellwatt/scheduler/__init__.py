"""Independent parts of long work, done one after the other, or by the workers of a dask scheduler."""

from cellwatt.scheduler.ambient import scheduled
from cellwatt.scheduler.spread import spread

__all__ = ["scheduled", "spread"]
