"""Makes frames from batches: all channels of a cell on one time grid."""

from cellwatt.align.aligner import Aligner
from cellwatt.align.track import Counts

__all__ = ["Aligner", "Counts"]
