"""Curves of free form: a joint's torque as a function of one state, for want of a law. A model holds them as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.effects.effect import Effect, Estimate, Parameter, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

KNOTS = 10
"""Number of knots of a curve."""
RANGE = 0.01, 0.99
"""Quantiles of the joint's motion at the first and last knot; beyond these a curve is constant."""
SMOOTH = 1.5
"""Number of knots over which the values of a curve are correlated."""
ROUGH = 0.05
"""Share of a knot's variance that is independent of its neighbours."""


@dataclass(frozen=True)
class Curve(Effect):
    """A smooth torque as a function of one state of a joint, linear between knots; the knots are its shape.

    ``of`` is the attribute of ``States`` that holds the state; ``along`` names the state in a sentence, in ``unit``.
    """

    name: str  # type: ignore[misc]  # set per instance; other effects set it per class
    of: str
    along: str
    unit: str

    def course(self, run: States, joint: int) -> Float:
        """The state (N,) that the torque is a function of."""
        return np.asarray(getattr(run, self.of)[:, joint])

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        """One shape, with equally many samples between neighbouring knots; none if the state has too few values."""
        course = np.concatenate([self.course(run, joint or 0) for run in runs])
        knots = np.unique(np.quantile(course, np.linspace(*RANGE, KNOTS)))
        return [tuple(knots.tolist())] if len(knots) == KNOTS else []

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        """Contribution (N, m) of 1 Nm at each of the m knots."""
        knots = np.asarray(shape)
        course = np.clip(self.course(run, joint or 0), knots[0], knots[-1])
        after = np.clip(np.searchsorted(knots, course, side="right"), 1, len(knots) - 1)
        share = (course - knots[after - 1]) / (knots[after] - knots[after - 1])
        out, rows = np.zeros((len(course), len(knots))), np.arange(len(course))
        out[rows, after - 1], out[rows, after] = 1 - share, share
        return out

    def prior(self, runs: Sequence[States], joint: int | None, columns: Float, size: Float) -> Prior:
        """Values at the knots have the channel's ``size`` as standard deviation; neighbouring values are correlated."""
        apart = np.subtract.outer(np.arange(columns.shape[1]), np.arange(columns.shape[1]))
        alike = (1 - ROUGH) * np.exp(-0.5 * np.square(apart / SMOOTH)) + ROUGH * (apart == 0)
        return Prior(np.zeros(columns.shape[1]), alike * size[joint or 0] ** 2)

    def parameters(self, estimate: Estimate, robot: RobotDescription, joint: int | None) -> Mapping[str, Parameter]:
        """Torque at each knot, Nm."""
        return {f"at_{knot:.4g}": estimate.coefficient(i, "N*m") for i, knot in enumerate(estimate.shape)}

    def statement(self, who: str, parameters: Mapping[str, Parameter]) -> str:
        """One plain sentence."""
        return f"{who} has a torque that goes with {self.along}."


CURVES: tuple[Curve, ...] = (
    Curve("position_curve", "q", "its position", "rad"),
    Curve("velocity_curve", "qd", "its velocity", "rad/s"),
    Curve("acceleration_curve", "qdd", "its acceleration", "rad/s^2"),
    Curve("load_curve", "rigid", "its load", "N*m"),
)
CURVE = {curve.name: curve for curve in CURVES}
