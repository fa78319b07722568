"""Times at which the processes of a cell check for new samples: one wake-up for many samples.

The times lie on one grid of CLOCK_MONOTONIC, the same in every process, so that a reading process wakes just after
the writing one.
"""

from __future__ import annotations

import math
import time
from typing import Final

GATHER: Final = 0.010
"""s for which samples gather while a consumer awaits them …"""
FRAME: Final = 0.5
"""… limited to this share of a frame's step."""
UNAWAITED: Final = 0.040
"""s for which they gather while no consumer awaits them …"""
LATE: Final = 0.4
"""… limited to this share of the time that a frame waits for late samples."""


def next_moment(period: float, after: float = 0.0) -> float:
    """The next time of a grid of ``period`` s, shifted by ``after`` s; s of CLOCK_MONOTONIC."""
    return (math.floor((time.monotonic() - after) / period) + 1) * period + after
