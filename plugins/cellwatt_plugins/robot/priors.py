"""What is known of an arm's numbers before anything is measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.robot.regression import Prior
from cellwatt_plugins.robot.rigid_body import PER_LINK

Float = NDArray[np.float64]


def link_prior(own: Float, tolerance: float) -> Prior:
    """Prior of a link's ten parameters: the whole link scaled, its centre moved, its inertia off by ``tolerance``."""
    mass = max(float(own[0]), 1e-3)
    centre = float(np.linalg.norm(own[1:4])) / mass
    inertia = float(np.max(np.abs(own[[4, 6, 9]])))
    deviations = np.empty(PER_LINK)
    deviations[0] = 0.2 * tolerance * mass
    deviations[1:4] = mass * (tolerance * centre + 0.001)
    deviations[4:] = tolerance * inertia + 1e-6 * mass
    return Prior(np.zeros(PER_LINK), np.outer(own, own) * tolerance**2 + np.diag(deviations**2))
