"""Codes (20) of one interval: -1, 0, 1 for power below, within and above what is healthy.

The paper compares the *energy* of an interval: "the energy residual vector is compared with a preset threshold
(±10 % over the reference/model values)". ``of_energy`` does so. ``of_samples`` asks (16) of each sample and takes the
side to which power left it first: that sees a short peak, of which little is left in the energy of its interval.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from cellwatt_plugins.faults.criteria import Tolerance, sustained, ternary

if TYPE_CHECKING:
    from cellwatt_plugins.faults.paper.expected import Readings

Residual = Literal["samples", "energy"]

FRAMES = 5
"""Readings in a row, on one side, that are outside: one alone proves nothing."""


def of_samples(reference: Readings, seen: Readings, tolerance: Tolerance) -> int:
    """The side to which power left (16) first, for ``FRAMES`` in a row; 0 if it did not."""
    return sustained(ternary(seen.power - reference.power, tolerance.watts(reference.power)), FRAMES)


def of_energy(reference: Readings, seen: Readings, tolerance: Tolerance) -> int:
    """Equation (20) as printed, of r = E - E_r; ``floor`` W count over the whole interval."""
    seconds = float(np.ptp(reference.t))
    healthy, found = (float(np.trapezoid(each.power, reference.t)) for each in (reference, seen))
    limit = max(tolerance.power * abs(healthy), tolerance.floor * seconds)
    return int(ternary(np.array([found - healthy]), limit)[0])
