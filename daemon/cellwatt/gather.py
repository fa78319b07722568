"""Moments at which the processes of a cell look for new samples: one wake-up for many samples.

The moments lie on one grid of CLOCK_MONOTONIC, the same in every process, so that a process that reads wakes just
after the one that writes.
"""

from __future__ import annotations

import math
import time
from typing import Final

GATHER: Final = 0.010
"""s for which samples gather while somebody awaits them …"""
FRAME: Final = 0.5
"""… and the most of a frame's step."""
UNAWAITED: Final = 0.040
"""s for which they gather while nobody does …"""
LATE: Final = 0.4
"""… and the most of the time that a frame waits for late samples."""


def next_moment(period: float, after: float = 0.0) -> float:
    """The next moment of a grid of ``period`` s, ``after`` s later than the grid, s of CLOCK_MONOTONIC."""
    return (math.floor((time.monotonic() - after) / period) + 1) * period + after
