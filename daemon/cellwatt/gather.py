"""Moments at which the processes of a cell look for new samples: one wake-up for many samples.

The moments lie on one grid of CLOCK_MONOTONIC, the same in every process, so that a process that reads wakes just
after the one that writes.
"""

from __future__ import annotations

import math
import time
from typing import Final

GATHER: Final = 0.010
"""s for which samples gather by default …"""
FRAME: Final = 0.5
"""… and the most of a frame's step."""


def next_moment(gather: float, share: float = 0.0) -> float:
    """The next moment of the grid of ``gather`` s, and ``share`` of a gather later, s of CLOCK_MONOTONIC."""
    return (math.floor(time.monotonic() / gather - share) + 1 + share) * gather
