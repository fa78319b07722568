"""A drive that gives no torque while its joint is near its command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States

SHARES = (0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
"""Quantiles of the error that are tried as the half width of the band."""
FROM_EDGE, FROM_CENTRE = 0.0, 1.0
"""Beyond the band, the torque is proportional to the distance from its edge, or to the whole error."""


class DriveDeadBand(Effect):
    """No torque while abs(command - position) is below the half width of the band."""

    name = "drive_dead_band"
    acts_on = "drive"
    form = Form(to_scale=True)
    acceptance = Acceptance()
    confusions = (
        Confusion("coulomb_friction", "push the joint by hand at rest: within a band it does not resist"),
        Confusion("backlash", "lock the motor: play remains, a dead band does not"),
    )
    shape_is = (("half_width", "rad"),)
    refined = (0.5, 2.0), (1.0, 1.0)
    sentence = "The drive of {joint} gives no torque within {half_width} of its command: a dead band is missing."

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        error = np.abs(np.concatenate([run.servos.error[:, joint or 0] for run in runs]))
        widths = np.unique(np.quantile(error, SHARES))
        return [(float(width), way) for width in widths if width > 0 for way in (FROM_EDGE, FROM_CENTRE)]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        servo, at, (width, way) = run.servos.servo, joint or 0, shape

        def lost(command: Float, position: Float, velocity: Float) -> Float:
            error = servo.pull[at] * command - servo.stiffness[at] * position
            band = servo.stiffness[at] * width
            return np.where(np.abs(error) < band, error, 0.0 if way == FROM_CENTRE else band * np.sign(error))

        return run.servos.over_rows(at, lost)[:, None]
