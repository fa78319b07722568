"""Static friction at rest: recorded torque compared with the law, which has no friction at rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.stretches import stretches

END = 0.1
"""s at each end of a rest whose means are compared."""
FEWEST = 4
"""Smallest number of rests of a joint for an estimate."""
UNKNOWN = np.inf


def held_at_rest(states: Sequence[States], residuals: Sequence[Float], noise: Float) -> Float:
    """Friction (n,) Nm that holds joints at rest; infinite if there is no plan, where it may have any value.

    ``residuals`` (N, n) Nm of each run are torque beyond the nominal, which a control loop releases while nothing
    moves: any change during a rest was held by friction. ``noise`` is (n,) Nm.
    """
    if any(run.unplanned for run in states):
        return np.full(len(noise), UNKNOWN)
    out = np.zeros(len(noise))
    for joint in range(len(noise)):
        changes = [
            float(np.mean(course[last - end : last]) - np.mean(course[first : first + end]))
            for run, part in zip(states, residuals, strict=True)
            for course, end in ((part[:, joint], max(1, round(END / run.step))),)
            for first, last in stretches(run.resting[:, joint])
            if last - first > 2 * end
        ]
        if len(changes) >= FEWEST:
            by_noise = 2 * np.square(noise[joint]) / max(1, round(END / states[0].step))
            out[joint] = np.sqrt(max(float(np.median(np.square(changes))) / 0.455 - by_noise, 0.0))
    return out
