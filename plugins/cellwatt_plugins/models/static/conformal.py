"""Intervals that hold a share of what is measured, whatever the errors' distribution.

Split conformal prediction on the errors of models that had not seen the pose (Vovk, Gammerman, Shafer 2005; on
cross-validation Barber et al., Annals of Statistics 49, 2021).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

COVERAGE: Final = 0.9


def half_width(errors: Float) -> float:
    """Half width that holds at least ``COVERAGE`` of new errors like ``errors`` (N,)."""
    size = np.sort(np.abs(errors))
    rank = int(np.ceil((len(size) + 1) * COVERAGE))
    return float(size[min(rank, len(size)) - 1])
