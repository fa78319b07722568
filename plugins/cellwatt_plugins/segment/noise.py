"""Position noise of each joint, learned from the positions while they come."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cellwatt.noise import white_noise

Float = NDArray[np.float64]

CHUNK = 64
"""Frames that give one estimate."""
MEMORY = 8
"""Estimates of which the smallest counts, so that jerky motion does not pass for noise."""


@dataclass
class NoiseEstimate:
    """``sigma`` (joints,) rad: standard deviation of the position noise; 0 until the first chunk is full.

    Fourth differences take out smooth motion, the median takes out jerks.
    """

    joints: int
    filled: int = 0
    sigma: Float = field(init=False)

    def __post_init__(self) -> None:
        self.sigma = np.zeros(self.joints)
        self._chunk: Float = np.empty((CHUNK, self.joints))
        self._estimates: deque[Float] = deque(maxlen=MEMORY)

    def add(self, positions: Float) -> None:
        """Take n more positions (n, joints) rad, at most ``CHUNK - filled``."""
        self._chunk[self.filled : self.filled + len(positions)] = positions
        self.filled += len(positions)
        if self.filled == CHUNK:
            self.filled = 0
            self._estimates.append(white_noise(self._chunk, 4))
            self.sigma = np.min(self._estimates, axis=0)
