"""Inertial parameters of bodies: moved between frames, and the nearest ones that a real body can have.

Ten parameters (m, m·c, Ixx Ixy Iyy Ixz Iyz Izz about the frame's origin) are those of a body that can exist if their
pseudo-inertia ∫ (p, 1)(p, 1)ᵀ dm is positive definite (Wensing, Kim, Slotine: Linear matrix inequalities for physically
consistent inertial parameter identification, 2018).
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cellwatt.arrays import Float
from cellwatt_plugins.robot.pseudo_inertia import ENTRIES, pseudo_inertia

_LOWER = np.tril_indices(4)
LEAST_MASS = 1e-4
"""Smallest mass of a body, kg."""
LEAST_RADIUS = 1e-3
"""Smallest extent of a body in each direction, m."""
PULL = 0.02
"""Weight of the parameters' differences relative to the torques' differences."""


def parameters_of(pseudo: Float) -> Float:
    """Ten parameters (…, 10) of a pseudo-inertia (…, 4, 4)."""
    spread = pseudo[..., :3, :3]
    tensor = np.trace(spread, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - spread
    entries = tensor[..., *ENTRIES]
    return np.concatenate([pseudo[..., 3, 3][..., None], pseudo[..., :3, 3], entries], axis=-1)


def moved(parameters: Float, frame: Float) -> Float:
    """Parameters (…, 10) in another frame; ``frame`` (4, 4) is the pose of the first frame in the other one."""
    return parameters_of(frame @ pseudo_inertia(parameters) @ frame.T)


def at_centre(parameters: Float) -> tuple[float, Float, Float]:
    """Mass kg, centre (3,) m and inertia xx yy zz xy xz yz (6,) kg m² about that centre of a body (10,)."""
    body = pin.Inertia.FromDynamicParameters(parameters)
    return float(body.mass), body.lever, body.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def physical(parameters: Float) -> NDArray[np.bool_]:
    """True for each body (…, 10) that can exist."""
    scale = np.array([1.0, 1.0, 1.0, LEAST_RADIUS])
    least = np.linalg.eigvalsh(pseudo_inertia(parameters) * np.outer(scale, scale))[..., 0]
    return np.asarray((parameters[..., 0] >= 0.5 * LEAST_MASS) & (least > 0.1 * LEAST_MASS * LEAST_RADIUS**2))


def nearest(wanted: Float, felt: Float) -> Float:
    """Bodies (L, 10) that can exist, whose torques differ least from those of ``wanted`` (L, 10).

    ``felt`` (10 L, 10 L): quadratic form of the mean square torque, in units of the noise, in parameter differences.
    """
    count = len(wanted)
    values, vectors = np.linalg.eigh(felt)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T
    scale = np.stack([_scale(row) for row in wanted])
    metric = np.array([1 / LEAST_RADIUS] * 3 + [1.0])
    floor = np.diag(LEAST_MASS / metric**2)

    def bodies(flat: Float) -> Float:
        lower = np.zeros((count, 4, 4))
        lower[:, _LOWER[0], _LOWER[1]] = flat.reshape(count, 10)
        return parameters_of(lower @ lower.transpose(0, 2, 1) + floor)

    def off(flat: Float) -> Float:
        difference = bodies(flat) - wanted
        return np.concatenate([root @ difference.ravel(), PULL * (difference / scale).ravel()])

    start = np.stack([_clipped(row - parameters_of(floor)) for row in wanted])
    found = least_squares(off, start[:, _LOWER[0], _LOWER[1]].ravel(), method="trf", x_scale="jac", max_nfev=200)
    return np.asarray(bodies(found.x))


def _scale(row: Float) -> Float:
    """Typical size of each of the ten parameters (10,) of a body like ``row`` (10,)."""
    mass = max(abs(float(row[0])), 0.1)
    reach = max(float(np.linalg.norm(row[1:4])) / mass, 0.05)
    return np.array([mass, *(3 * [mass * reach]), *(6 * [mass * reach**2])])


def _clipped(row: Float) -> Float:
    """Lower triangle L (4, 4) with L Lᵀ near the pseudo-inertia of a row (10,)."""
    values, vectors = np.linalg.eigh(pseudo_inertia(row))
    positive = vectors @ np.diag(np.maximum(values, 1e-6 * max(float(values[-1]), 1e-6))) @ vectors.T
    return np.asarray(np.linalg.cholesky(positive))
