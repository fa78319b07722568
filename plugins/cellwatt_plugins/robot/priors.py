"""Priors of an arm's numbers, before anything is measured.

A tolerance of robot.yaml is one standard deviation, as a share of the stated number: two thirds of all arms are within
it. Every plugin uses it without a factor of its own.
"""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.regression import Prior

ALONE = 0.2
"""Standard deviation of a mass independent of the link's other parameters, as a share of the tolerance."""
CLOSE = 0.001
"""Smallest standard deviation of a centre of mass, in m, however near it is to the joint."""


def link_prior(own: Float, tolerance: float) -> Prior:
    """Return the prior of the errors (kg, kg m, kg m²) of a link's ten described parameters, ``own`` (10,).

    The whole link is scaled, and mass, centre of mass and moments of inertia also deviate independently of each other:
    by ``tolerance``, one standard deviation as a share.
    """
    mass = max(float(own[0]), 1e-3)
    centre = float(np.linalg.norm(own[1:4])) / mass
    inertia = float(np.max(np.abs(own[[4, 6, 9]])))
    deviations = np.empty(PER_LINK)
    deviations[0] = ALONE * tolerance * mass
    deviations[1:4] = mass * (tolerance * centre + CLOSE)
    deviations[4:] = tolerance * inertia + 1e-6 * mass
    return Prior(np.zeros(PER_LINK), np.outer(own, own) * tolerance**2 + np.diag(deviations**2))


def links_prior(own: Float, tolerance: float) -> Prior:
    """Return ``link_prior`` of all n links, independent of one another, for described parameters (10 n,)."""
    return Prior.joined(*(link_prior(each, tolerance) for each in own.reshape(-1, PER_LINK)))


def body_prior(mass: float, reach: float) -> Prior:
    """Return the prior of the ten parameters of a body that is attached to the last link.

    It has about ``mass`` kg, and its centre is within about ``reach`` m of the last joint's frame.
    """
    return Prior.spread(mass * np.array([1.0, reach, reach, reach, *(6 * [0.4 * reach**2])]))
