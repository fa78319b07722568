"""Mass at the flange that the simulation lacks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Relations, Uncertainty
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Plausible, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.priors import body_prior
from cellwatt_plugins.robot.regression import Prior

HEAVY = 0.15
"""Share of the arm's own mass that a payload is expected to weigh."""
REACH = 0.12
"""m from the last joint's frame within which a payload's centre of mass is expected."""


class Payload(Effect):
    """A rigid body on the last link: mass, first moments and inertia in the last joint's frame."""

    name = "payload"
    acts_on = "links"
    whole_arm = True
    acceptance = Acceptance(above=0.0)
    relations = Relations(plainer=10.0)
    uncertainty = Uncertainty(torque_gain=("mass",))
    plausible: ClassVar[Plausible | None] = (
        (lambda c: float(np.linalg.norm(c[1:4]) / c[0]) if c[0] > 0 else np.inf),
        0.0,
        1.0,
    )
    """A load whose centre is more than a metre from the flange is an error of the links."""
    confusions: ClassVar[tuple[Confusion, ...]] = (
        Confusion("link_inertial_error", "weigh with the tool off, then on: an error of the last link stays"),
        Confusion("gravity_tilt", "turn joint 1 about its vertical axis: a tilt loads it, a payload does not"),
    )
    sentence = "The flange carries {mass} at ({com_x:.3f}, {com_y:.3f}, {com_z:.3f}) m: a payload is missing."

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return run.regressor[:, :, -10:]

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        return body_prior(HEAVY * float(np.sum(runs[0].arm.body.parameters()[::10])), REACH)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        """Mass and centre of mass (with their deviations) of ten inertial coefficients."""
        mass = estimate.coefficients[0]
        out = {"mass": estimate.coefficient(0, "kg")}
        for i, axis in enumerate("xyz", start=1):
            centre = estimate.coefficients[i] / mass
            slope = np.array([-centre / mass, 1 / mass])
            own = estimate.covariance[np.ix_([0, i], [0, i])]
            out[f"com_{axis}"] = Parameter(float(centre), float(np.sqrt(max(0.0, slope @ own @ slope))), "m")
        return out
