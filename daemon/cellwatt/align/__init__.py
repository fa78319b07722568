"""Makes frames from batches: all channels of a cell on one time grid.

aligner   the state machine from batches and ticks to frames
lane      of each stream: when a grid point is settled, and how long to wait for it
track     of each stream: the samples that coming frames need, and counts of late ones
methods   values at grid points: linear, average, hold
"""

from cellwatt.align.aligner import Aligner
from cellwatt.align.track import Counts

__all__ = ["Aligner", "Counts"]
