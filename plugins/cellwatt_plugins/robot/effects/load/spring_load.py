"""A spring on a joint: balancer, hose or cable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.declaration import Acceptance, Confusion, Relations
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

NEAR = 1.5
"""Prior standard deviation in rad of a spring's rest about the middle of the joint's motion."""


class SpringLoad(Effect):
    """k (q - q0)."""

    name = "spring_load"
    acceptance = Acceptance(above=0.0)
    plausible = (lambda c: float(-c[1] / c[0]) if c[0] else np.inf), -3 * np.pi, 3 * np.pi
    """A hose or balancer rests within a turn of the joint's motion."""
    relations = Relations(contains=("torque_offset",), along="position", beats=("torque_offset",))
    confusions = (
        Confusion("link_inertial_error", "move the joint over its whole range: gravity turns back, a spring does not"),
        Confusion("torque_offset", "hold the joint at several positions"),
    )
    sentence = "{who} is pulled with {stiffness} towards {rest:.2f} rad: a spring (balancer, hose or cable) is missing."

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        return np.column_stack([run.q[:, joint], np.ones(len(run.time))])

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """A spring that rests near the joint's motion, whatever the zero of the joint's angle."""
        q = np.concatenate([run.q[:, joint] for run in runs])
        middle, stiffness = float(np.mean(q)), size[joint or 0] / max(float(np.std(q)), 1e-3)
        covariance = np.array([[1.0, -middle], [-middle, middle**2 + NEAR**2]])
        return Prior(np.zeros(2), stiffness**2 * covariance)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        stiffness, constant = estimate.coefficients[:2]
        slope = np.array([constant / stiffness**2, -1 / stiffness])
        spread = float(np.sqrt(max(0.0, slope @ estimate.covariance[:2, :2] @ slope)))
        rest = Parameter(float(-constant / stiffness), spread, "rad")
        return {"stiffness": estimate.coefficient(0, "N*m/rad"), "rest": rest}
