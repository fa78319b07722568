"""A drive whose force limit is lower than the simulation's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States

MOST = (0.5, 0.7, 0.8, 0.88, 0.93, 0.96, 0.98, 0.99, 0.997)
"""Quantiles of the law's torque; the median torque of the motion above each is tried as the limit."""
FOLLOWS = 0.5
"""Share of the law's torque that the motion's torque follows: more up to the limit, less beyond it."""
UP_TO = 0.5
"""Share of the limit from which the drive must follow its law."""
CLIPPED = 8
"""Fewest samples beyond the limit."""


class DriveLimit(Effect):
    """The drive's torque is at most its limit, whatever its law gives."""

    name = "torque_saturation"
    acts_on = "drive"
    form = Form(to_scale=True, error=0.02)
    confusions = (Confusion("drive_gain", "move slower: a soft loop remains soft, a limit is not reached"),)
    shape_is = (("limit", "N*m"),)
    refined = ((0.7, 1.3),)
    sentence = "The drive of {joint} gives at most {limit}: its limit is lower than the simulation's."

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        asked, given = self._torques(runs, joint or 0)
        levels = [float(np.median(given[asked >= np.quantile(asked, share)])) for share in MOST]
        return [(level,) for level in levels if level > 0 and np.count_nonzero(asked > level) >= CLIPPED]

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        """True if the drive follows its law up to the limit, and beyond it gives the same torque whatever the law
        gives."""
        asked, given = self._torques(runs, joint or 0)
        beyond, below = asked > shape[0], (asked > UP_TO * shape[0]) & (asked < shape[0])
        if np.sum(given[below]) < FOLLOWS * np.sum(asked[below]) or np.count_nonzero(beyond) < CLIPPED:
            return False
        off = asked[beyond] - np.mean(asked[beyond])
        return float(off @ given[beyond]) <= FOLLOWS * float(off @ off)

    @staticmethod
    def _torques(runs: Sequence[States], at: int) -> tuple[Float, Float]:
        """Torque (N,) Nm of a joint by the law of its drive, and the motion's torque in that direction."""
        asked = np.concatenate([run.servos.torque[:, at] for run in runs])
        return np.abs(asked), np.sign(asked) * np.concatenate([run.nominal[:, at] for run in runs])

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        drive, at = run.servos, joint or 0
        more = drive.beyond(at, drive.servo.low[at], drive.servo.high[at])
        return (drive.beyond(at, -shape[0], shape[0]) - more)[:, None]
