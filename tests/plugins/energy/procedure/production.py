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
    park: tuple[float, ...] = ()
    """rad: where the arm waits, if not where it ended."""
    way: float = 0.0
    """s to that pose, and again back."""


def play(plant, cycle: Cycle):
    """One cycle at 500 Hz: rows (N, 3 n) of q, qd and torque as given, and power (N,) W."""
    moves = [plant.motion(cycle.speed)]
    home = moves[0][0][-1]
    count = round(cycle.seconds / STEP) - len(moves[0][0])
    if cycle.park:
        there = np.array(cycle.park)
        out, back = _move(home, there, cycle.way), _move(there, home, cycle.way)
        moves += [out, _still(there, count - len(out[0]) - len(back[0])), back]
    else:
        moves.append(_still(home, count))
    q, qd, qdd = (np.vstack(columns) for columns in zip(*moves, strict=True))
    torque = plant.torque(q, qd, qdd, cycle.payload)
    on = np.zeros(len(q), bool)
    if cycle.brakes_after is not None:
        on[len(moves[0][0]) + round(cycle.brakes_after / STEP) :] = True
        torque[on] = 0.0
    watts = plant.powers(torque, qd)["supply"] + plant.made.fixed - plant.made.brakes * on
    return np.hstack([q, qd, torque * np.array(plant.made.gains or 1.0)]), watts


def _still(pose, count):
    q = np.repeat(pose[None], count, axis=0)
    return q, 0 * q, 0 * q


def _move(start, end, seconds):
    """Minimum jerk from one pose to another."""
    s = ((np.arange(round(seconds / STEP)) + 1) * STEP / seconds)[:, None]
    way = end - start
    return (
        start + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        way * (30 * s**2 - 60 * s**3 + 30 * s**4) / seconds,
        way * (60 * s - 180 * s**2 + 120 * s**3) / seconds**2,
    )
