"""Codes (20) of one interval: -1, 0, 1 for power below, within and above the healthy tolerance.

The paper compares the *energy* of an interval: "the energy residual vector is compared with a preset threshold
(±10 % over the reference/model values)", as ``of_energy`` does. ``of_samples`` applies (16) to each sample and returns
the side on which power first leaves the tolerance: it detects a short peak that hardly changes the interval's energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from cellwatt_plugins.faults.criteria import Tolerance, sustained, ternary

if TYPE_CHECKING:
    from cellwatt_plugins.faults.paper.expected import Readings

Residual = Literal["samples", "energy"]

FRAMES = 5
"""Consecutive samples outside on one side that count as a deviation: a single one proves nothing."""


def of_samples(reference: Readings, seen: Readings, tolerance: Tolerance) -> int:
    """The side on which power first left tolerance (16) for ``FRAMES`` consecutive samples; 0 if it did not."""
    return sustained(ternary(seen.power - reference.power, tolerance.watts(reference.power)), FRAMES)


def of_energy(reference: Readings, seen: Readings, tolerance: Tolerance) -> int:
    """Equation (20) as printed, for r = E - E_r; ``floor`` W applies to the whole interval."""
    seconds = float(np.ptp(reference.t))
    healthy, found = (float(np.trapezoid(each.power, reference.t)) for each in (reference, seen))
    limit = max(tolerance.power * abs(healthy), tolerance.floor * seconds)
    return int(ternary(np.array([found - healthy]), limit)[0])
