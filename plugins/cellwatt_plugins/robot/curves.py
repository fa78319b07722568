"""Curves of any form: what a joint's torque follows where no law is known. They enter a model as tables."""

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
"""Knots of a curve."""
RANGE = 0.01, 0.99
"""Quantiles of the joint's motion between which a curve is known; it is held beyond."""
SMOOTH = 1.5
"""Knots over which a curve changes."""
ROUGH = 0.05
"""Share of its variance by which neighbouring knots may differ."""


@dataclass(frozen=True)
class Curve(Effect):
    """A smooth torque along one course of a joint, linear between the knots that are its shape.

    The course is that of ``States`` called ``of``; ``along`` says it in words, in ``unit``.
    """

    name: str  # type: ignore[misc]  # of each instance, where other effects have one a class
    of: str
    along: str
    unit: str

    def course(self, run: States, joint: int) -> Float:
        """The course (N,) along which the torque is told."""
        return np.asarray(getattr(run, self.of)[:, joint])

    def shapes(self, runs: Sequence[States], joint: int | None, residual: Sequence[Float]) -> Sequence[Shape]:
        """One shape, whose knots have as many samples between each two."""
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
        """Values at the knots are of the channel's ``size``, and near those of their neighbours."""
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
