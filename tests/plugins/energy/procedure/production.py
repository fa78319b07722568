"""What an arm of the plant does in a cell: its cube, then waiting; and the same as an advice would have it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.plugins.energy.procedure.plant import STEP


@dataclass(frozen=True)
class Cycle:
    """One way round the cube, and what the arm does until the next."""

    speed: float
    """mm/s, mean over the way."""
    seconds: float
    """From one beginning to the next."""
    payload: float = 0.0
    brakes_after: float | None = None
    """s after the way: then the brakes are on until the next."""


def play(plant, cycle: Cycle):
    """One cycle at 500 Hz: rows (N, 3 n) of q, qd and torque as given, and power (N,) W."""
    moving = plant.motion(cycle.speed)
    waiting = round(cycle.seconds / STEP) - len(moving[0])
    q = np.vstack([moving[0], np.repeat(moving[0][-1:], waiting, axis=0)])
    qd, qdd = (np.vstack([each, np.zeros((waiting, q.shape[1]))]) for each in moving[1:])
    torque = plant.torque(q, qd, qdd, cycle.payload)
    on = np.zeros(len(q), bool)
    if cycle.brakes_after is not None:
        on[len(moving[0]) + round(cycle.brakes_after / STEP) :] = True
        torque[on] = 0.0
    watts = plant.powers(torque, qd)["supply"] + plant.made.fixed - plant.made.brakes * on
    return np.hstack([q, qd, torque * np.array(plant.made.gains or 1.0)]), watts
