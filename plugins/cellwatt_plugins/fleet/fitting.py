"""Fits the friction of each joint to samples of repetitions.

Each joint's torque is the torque for its links and rotor, fitted with the description as the prior, plus friction.
Friction changes sign with the direction of motion, so that wrong masses hardly affect it.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.priors import body_prior, links_prior
from cellwatt_plugins.robot.regression import Prior, solve

SLIDES: Final = 0.05
"""Speed above which a joint slides with full friction, rad/s."""
FEWEST: Final = 40
"""Fewest samples in which a joint slides; with fewer its friction is not fitted."""
LOOSE: Final = 0.1
"""Standard deviation of the unknown factor of torque."""
OFF: Final = 0.3
"""Standard deviation of a repetition's friction and rigid torque about the week's, as shares."""


@dataclass(frozen=True)
class JointFit:
    """Fitted friction of one joint over K repetitions: Nm, Nm s/rad, mean ``speed`` rad/s while sliding."""

    coulomb: float
    viscous: float
    speed: float
    friction: Float
    """Friction (K,) of each repetition, as a share of the week's."""


def links_of(arm: Arm) -> list[Prior]:
    """Return for each joint the prior of the parameter errors of the links that it moves, including a load."""
    every = arm.body.parameters()
    load = body_prior(max(arm.description.payload, 0.05 * float(every[::PER_LINK].sum())), 0.2)
    out = []
    for i in range(arm.joints):
        links = links_prior(every[PER_LINK * i :], arm.description.tolerances.link)
        prior = Prior(links.mean, links.covariance + np.pad(load.covariance, (len(links.mean) - PER_LINK, 0)))
        assert prior.precision.shape  # computes the cached precision
        out.append(prior)
    return out


def fit_joint(
    arm: Arm, i: int, prior: Prior, rows: Float, qd: Float, qdd: Float, torque: Float, ends: NDArray[np.intp]
) -> JointFit:
    """Fit joint ``i`` (0-based) to its torque (N,) Nm with its regressor ``rows`` (N, k)."""
    slides = np.abs(qd) > SLIDES * arm.body.levers[i]
    if slides.sum() < FEWEST:
        return JointFit(np.nan, np.nan, np.nan, np.full(len(ends), np.nan))
    rotor = arm.description.joints[i].rotor_inertia
    modelled = rows @ arm.body.parameters()[PER_LINK * i :] + rotor * qdd
    size = float(np.sqrt(np.mean(np.square(torque[slides])))) or 1.0
    loose = 0.3 * rotor + 0.1 * size / max(float(np.sqrt(np.mean(np.square(qdd)))), 1e-6)
    known = Prior.spread(np.array([2 * size, 2 * size, 0.2 * size, LOOSE, loose]))
    matrix = np.column_stack([direction(qd), qd, np.ones_like(qd), modelled, qdd, rows])
    found = _solved(matrix[slides], (torque - modelled)[slides], Prior.joined(known, prior), size)
    residual = torque - modelled - matrix @ found
    shape = found[0] * matrix[:, 0] + found[1] * qd
    level = _by_repetition(np.column_stack([shape, modelled, np.ones_like(qd)]), residual, slides, ends, size)
    return JointFit(found[0], found[1], float(np.abs(qd[slides]).mean()), 1 + level)


def _solved(matrix: Float, target: Float, prior: Prior, size: float) -> Float:
    """Most probable coefficients, with the noise estimated from their residual."""
    noise = (0.05 * size) ** 2
    for _ in range(2):
        found = solve(matrix, target, noise, prior).coefficients
        noise = max(float(np.mean((target - matrix @ found) ** 2)), (1e-4 * size) ** 2)
    return found


def _by_repetition(
    columns: Float, residual: Float, slides: NDArray[np.bool_], ends: NDArray[np.intp], size: float
) -> Float:
    """Deviation (K,) of each repetition's friction from the week's, as a share; rigid torque may deviate as well."""
    out = np.full(len(ends), np.nan)
    prior = Prior.spread(np.array([OFF, OFF, 0.2 * size]))
    noise = float(np.mean(np.square(residual[slides])))
    for k, (first, last) in enumerate(pairwise([0, *ends.tolist()])):
        rows = np.arange(first, last)[slides[first:last]]
        if len(rows) >= FEWEST // 2:
            out[k] = solve(columns[rows], residual[rows], noise, prior).coefficients[0]
    return out
