"""Play between a drive and its link, as seen by an encoder on the link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Form
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import FAST
from cellwatt_plugins.robot.regression import Prior
from cellwatt_plugins.robot.servo.filtered import derivatives

WIDTHS = (0.02, 0.06, 0.15, 0.4)
"""Shares of the load's spread within which the drive crosses the gap."""
SMALL, LARGE = 1e-3, 0.06
"""rad of half a gap: a smaller one is not resolved, a larger one is a broken gear."""


class Play(Effect):
    """The link rests on one flank or the other; where its load reverses, the rotor alone crosses the gap.

    The encoder is on the link: the rotor is half the gap ahead of it, in the load's direction, and must be accelerated
    and braked to get there.
    """

    name = "backlash"
    form = Form(sample_by_sample=True)
    acceptance = Acceptance(least_rate=FAST, exact_times=True, above=SMALL, by_evidence=80.0)
    """The law does not follow single rebounds of a link in the gap, in data left out as little as in others."""
    confusions = (
        Confusion("presliding_hysteresis", "reverse slowly where gravity loads the joint: a gap then stays closed"),
    )
    sentence = "{who} has a play of {gap} between drive and link: backlash is missing."
    refined = ((0.5, 2.0),)

    def possible(self, robot: RobotDescription, joint: int | None) -> bool:
        return robot.joints[joint or 0].rotor_inertia > 0

    def sensible(self, coefficients: Float, shape: Shape, robot: RobotDescription, joint: int | None) -> bool:
        return bool(coefficients[0] < LARGE)

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        loads = np.concatenate([run.rigid[:, joint or 0] for run in runs])
        if not np.min(loads) < 0 < np.max(loads):
            return []
        return [(share * float(np.std(loads)),) for share in WIDTHS]

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        own = run.robot.joints[joint or 0]
        ahead = np.tanh(run.rigid[:, [joint or 0]] / shape[0])
        speed, gain = derivatives(ahead, run.step)
        return np.asarray(own.rotor_inertia * gain + own.viscous_friction * speed)

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        return Prior.spread(np.array([0.3 * LARGE]))

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        return {"gap": Parameter(2 * estimate.coefficients[0], 2 * estimate.coefficient(0, "rad").std, "rad")}
