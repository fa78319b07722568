"""Types of the arrays that go through the whole of cellwatt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]
Nanoseconds = NDArray[np.int64]
Qualities = NDArray[np.uint8]
"""``Quality`` of each sample, as a number."""
