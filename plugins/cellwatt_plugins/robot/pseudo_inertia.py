"""Ten inertial parameters of a body as its pseudo-inertia ∫ (p, 1)(p, 1)ᵀ dm."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float

ENTRIES = np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2])
"""Rows and columns of Ixx Ixy Iyy Ixz Iyz Izz in a tensor (3, 3), in the order of the parameters."""


def pseudo_inertia(parameters: Float) -> Float:
    """Pseudo-inertia (…, 4, 4) of ten parameters (…, 10): second moments of mass, m·c and m."""
    rows, columns = ENTRIES
    tensor = np.zeros((*parameters.shape[:-1], 3, 3))
    tensor[..., rows, columns] = tensor[..., columns, rows] = parameters[..., 4:]
    trace = np.trace(tensor, axis1=-2, axis2=-1)[..., None, None]
    out = np.zeros((*parameters.shape[:-1], 4, 4))
    out[..., :3, :3] = 0.5 * trace * np.eye(3) - tensor
    out[..., :3, 3] = out[..., 3, :3] = parameters[..., 1:4]
    out[..., 3, 3] = parameters[..., 0]
    return out
