"""Measured torque that is clipped."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.noise import white_noise
from cellwatt_plugins.robot.effects.declaration import Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States

BELOW = (0.0, 1.0, 2.0, 3.0)
"""Standard deviations below the greatest measured torque at which a limit is tried."""
CLIPPED = 10
"""Fewest samples that must be clipped."""
FINEST = 0.002
"""Smallest noise of a measured torque, as a share of the greatest one."""
APART = 4
"""Samples from one value of the noise estimate to the next: it uses rows of the fit only."""
FLAT = 2.0
"""Standard deviations from the limit: most clipped samples measure within, and their mean fitted torque is beyond."""
BEYOND = 0.3
"""Largest share of the torques measured about the limit that may exceed it by more than one standard deviation."""
AMONG = (10, 20, 40)
"""Numbers of greatest fitted torques whose median measured torque is also tried as a limit: it is that of clipping."""


class TorqueSaturation(Effect):
    """A torque beyond the limit is measured as the limit."""

    name = "torque_saturation"
    acts_on = "reading"
    depends_on = "fitted torque"
    form = Form(to_scale=True)
    confusions = (Confusion("torque_gain", "move slower: a gain remains, clipping vanishes"),)
    shape_is = (("limit", "N*m"),)
    refined = ((0.95, 1.05),)
    sentence = "The torque measured at {joint} is clipped at {limit}."

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        # A clipped torque is never measured above the limit.
        read = np.concatenate(
            [np.abs(run.torque[:, joint] + r[:, joint]) for run, r in zip(runs, residual, strict=True)]
        )
        asked = np.concatenate([np.abs(run.torque[:, joint]) for run in runs])
        # A residual not explained yet is no measurement noise; values between the rows of the fit have no noise.
        scatter = float(np.median(np.abs(np.concatenate([r[:, joint] for r in residual])))) / 0.6745
        spread = max(min(scatter, float(white_noise(read[::APART])[0])), FINEST * float(np.max(read)))
        levels = [float(np.max(read)) - below * spread for below in BELOW]
        greatest = np.argsort(-asked)[: max(AMONG)]
        levels += [float(np.median(read[greatest[:count]])) for count in AMONG]
        return [(level,) for level in levels if level > 0 and _clipped(read, asked, level, spread)]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        torque = run.torque[:, joint]
        return (np.clip(torque, -shape[0], shape[0]) - torque)[:, None]


def _clipped(read: Float, asked: Float, level: float, spread: float) -> bool:
    """True if fitted torques clearly above a limit are measured as the limit, and hardly any is measured above it."""
    over, near = asked > level, read > level - spread
    return (
        int(np.count_nonzero(over)) >= CLIPPED
        and float(np.mean(asked[over])) > level + FLAT * spread
        and float(np.median(np.abs(read[over] - level))) < FLAT * spread
        and float(np.mean(read[near] > level + spread)) < BEYOND
    )
