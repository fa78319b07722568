"""The fault tables of Sabry et al.: ternary codes (rows: intervals, columns: joints 1 to 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.int8]

PICK_AND_PLACE: Codes = np.array(
    [
        [0, 0, 0, 0, 0, -1],
        [0, 0, 1, -1, 1, -1],
        [1, -1, 0, 0, 0, 0],
        [0, 0, 1, -1, 1, -1],
        [1, -1, 0, 0, 1, -1],
        [0, 0, 0, 1, -1, 1],
    ],
    dtype=np.int8,
)
"""Table I, "Assigning faulty joint according to activated time interval": six intervals of a pick-and-place task."""

POLISHING: Codes = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1, -1, 0, 0, 1, -1],
        [1, -1, 0, 0, 0, 1],
        [1, -1, 1, -1, 0, 0],
        [1, -1, 0, 0, 0, 1],
        [1, -1, 1, -1, 0, 0],
        [1, -1, 0, 0, 0, 1],
        [0, 0, 1, -1, 0, 0],
        [1, -1, 0, 0, 0, 1],
        [0, 0, 0, 0, 0, 0],
    ],
    dtype=np.int8,
)
"""Table II, "Faults table of the polishing task": ten intervals."""

TARGETS: Codes = np.array([1, -1, 1, -1, 1, -1], dtype=np.int8)
"""Last row of both tables: the target outputs Y1 … Y6."""
