"""Independent parts of long work, done one after the other, or by the workers of a dask scheduler."""

from cellwatt.scheduler.spread import spread

__all__ = ["spread"]
