"""The fitted model of rigid bodies, friction and drives of an arm, as formulas for both arrays and model files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float, rows_of
from cellwatt_plugins.models.dynamics import carried, inverse_dynamics
from cellwatt_plugins.models.power.design import CARRIED, PER_WARMTH, Rows, shared_columns
from cellwatt_plugins.models.power.leftover import inputs
from cellwatt_plugins.models.power.perceptron import Perceptron
from cellwatt_plugins.models.power.smoothing import Smoother
from cellwatt_plugins.models.power.supply import Supply
from cellwatt_plugins.models.power.terms import TORQUE, Motion
from cellwatt_plugins.onnx_graph import Graph, Tensor
from cellwatt_plugins.robot import Body
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.drive import Drives

AT_ONCE: Final = 5000
"""Number of rows whose columns are in memory together."""


@dataclass(frozen=True)
class Hybrid:
    """A fitted arm of n joints."""

    smoother: Smoother
    width: float
    """rad/s within which friction reverses."""
    inertial: Float
    """(10 n,), or (10 n + 4,) if a payload was recorded: the last 4 are the load's, per kg of payload."""
    terms: tuple[str, ...]
    weights: Float
    """(terms, n): Nm per unit of each term."""
    constant: Float
    """(n,) Nm/A."""
    resistance: Float
    """(n,) Ω."""
    supply: Supply | None
    """None if no power was recorded."""
    temperature: Float | None
    """Mean (n,) °C of the training, if friction depends on temperature."""
    leftover: Perceptron | None = None
    """The joints' networks of the torque residual, ``stacked``."""

    def torque(self, motion: Motion) -> Any:
        """Torque (N, n) Nm for a motion with its load."""
        terms = zip(self.terms, self.weights, strict=True)
        torque = motion.load + sum(TORQUE[name](motion) * weight for name, weight in terms)
        return torque if self.leftover is None else torque + self.leftover.by_joint(inputs(motion))

    def motion(self, rows: Rows, shared: Float) -> Motion:
        """Motion that the terms depend on, from rows and the columns of the inertial parameters."""
        load = shared @ self.inertial
        return Motion(rows.q, rows.qd, rows.qdd, load, np.tanh(rows.qd / self.width), rows.warmth)

    def trace(self, seen: Tensor, body: Body, columns: int) -> tuple[Motion, Any]:
        """The motion and the torque (N, n) in a model file, for windows ``seen`` whose rows hold ``columns`` values."""
        joints = body.joints
        q, qd, qdd = self.smoother.trace(seen if columns == 2 * joints else seen.part(0, 2 * joints), joints)
        load: Any = inverse_dynamics(body, q, qd, qdd, self.inertial[: PER_LINK * joints])
        if self.carries(joints):
            unit = inverse_dynamics(body, q, qd, qdd, carried(body, self.inertial[-CARRIED:]))
            load = load + unit * self.smoother.trace_as_is(seen, 2 * joints, 1)
        warmth = None
        if self.temperature is not None:
            here = self.smoother.trace_as_is(seen, columns - joints, joints)
            warmth = (here - self.temperature) / PER_WARMTH
        motion = Motion(q, qd, qdd, load, np.tanh(qd / self.width), warmth)
        return motion, self.torque(motion)

    def outputs(self, torque: Any, qd: Any) -> tuple[Any, Any]:
        """Power (N, 1) W, None if the model has none, and currents (N, n) A."""
        drive = Drives.of(torque, qd, torque / self.constant, self.resistance)
        return None if self.supply is None else self.supply.power(drive), drive.current

    def estimate(self, rows: Rows, body: Body) -> tuple[Float, Float]:
        """Power (N,) W, NaN if the model has none, and currents (N, n) A of smoothed rows."""
        power, current = np.full(len(rows), np.nan), np.empty_like(rows.q)
        for first in range(0, len(rows), AT_ONCE):
            part = rows_of(rows, slice(first, first + AT_ONCE))
            motion = self.motion(part, shared_columns(part, body, self.carries(body.joints)))
            watts, amperes = self.outputs(self.torque(motion), part.qd)
            current[first : first + AT_ONCE] = amperes
            if watts is not None:
                power[first : first + AT_ONCE] = watts[:, 0]
        return power, current

    def content(self, body: Body) -> bytes:
        """The ONNX graph from positions, velocities, and payload and temperatures if used, to power and currents."""
        joints = body.joints
        columns = (2 + (self.temperature is not None)) * joints + self.carries(joints)
        graph = Graph(columns, self.smoother.window)
        motion, torque = self.trace(graph.input, body, columns)
        power, current = self.outputs(torque, motion.qd)
        return graph.model([current] if power is None else [power, current], joints + (power is not None))

    def carries(self, joints: int) -> bool:
        """True if a payload is an input."""
        return len(self.inertial) > PER_LINK * joints
