"""Inputs of the paper's two estimators, and the layout of their model files.

Development of Deep Learning for Power Energy Optimization in the Industrial Robot System: ``nls`` holds its physical
model, equations (10) to (14), ``scg_network`` its networks, trained by scaled conjugate gradient, (6) to (9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.dynamics import inverse_dynamics
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.smoothing import Smoother
from cellwatt_plugins.models.power.terms import Motion
from cellwatt_plugins.models.power.tuning import Tuning
from cellwatt_plugins.onnx_graph import Graph, Tensor
from cellwatt_plugins.robot import Arm, Body

ROWS: Final = 8000
"""Number of rows that each is trained on."""
BESIDE: Final = 1
"""Number of rows before and after an estimated row, from which the rate of a current is computed."""


@dataclass(frozen=True)
class Seen:
    """N rows of smoothed motion with the URDF's torque."""

    motion: Motion
    bounds: tuple[tuple[int, int], ...]
    """First row of each move, and the row after its last."""
    step: float
    constant: Float
    """(n,) Nm/A, as stated."""

    @classmethod
    def of(cls, moves: Moves, arm: Arm, tuning: Tuning) -> Seen:
        """All rows of the moves."""
        q, qd, qdd = tuning.smoother.apply(moves)
        motion = Motion(q, qd, qdd, arm.body.inverse_dynamics(q, qd, qdd), np.tanh(qd / tuning.width))
        return cls(motion, tuple(moves.bounds()), moves.step, arm.column("torque_constant"))

    def here(self, values: Float) -> Float:
        """The estimated rows: all of them."""
        return values

    def rate(self, values: Float) -> Float:
        """Time derivative of columns (N, n), move by move."""
        out = np.zeros_like(values)
        for a, b in self.bounds:
            if b - a > 2 * BESIDE:
                out[a:b] = np.gradient(values[a:b], self.step, axis=0)
        return out

    def given(self, power: Float | None, current: Float) -> tuple[Float, Float]:
        """Estimated power (N,) W, NaN if there is none, and currents (N, n) A, from power (N, 1)."""
        return np.full(len(current), np.nan) if power is None else power[:, 0], current


@dataclass(frozen=True)
class Traced:
    """A motion in a model file: tensors (3 N, n) of the rows before, the estimated rows, and the rows after."""

    graph: Graph
    motion: Motion
    joints: int
    step: float
    """s between two rows."""

    @classmethod
    def of(cls, body: Body, smoother: Smoother, width: float, step: float) -> Traced:
        """In a new graph of positions and velocities, whose window is the smoother's plus ``BESIDE`` rows on both
        sides."""
        joints, window = body.joints, smoother.window
        graph = Graph(2 * joints, window + 2 * BESIDE)
        windows = [graph.input.part(i, i + window, axis=1) for i in (0, BESIDE, 2 * BESIDE)]
        q, qd, qdd = smoother.trace(graph.op("Concat", *windows, axis=0), joints)
        load = inverse_dynamics(body, q, qd, qdd)
        return cls(graph, Motion(q, qd, qdd, load, np.tanh(qd / width)), joints, step)

    def here(self, values: Tensor) -> Tensor:
        """The estimated rows, (N, n)."""
        return self._parts(values)[1]

    def rate(self, values: Tensor) -> Tensor:
        """Time derivative of the estimated rows, (N, n)."""
        before, _, after = self._parts(values)
        rate: Tensor = (after - before) * (1 / (2 * BESIDE * self.step))
        return rate

    def given(self, power: Tensor | None, current: Tensor) -> bytes:
        """The model file that gives power (N, 1), if known, and currents (N, n)."""
        return self.graph.model([current] if power is None else [power, current], self.joints + (power is not None))

    def _parts(self, values: Tensor) -> list[Tensor]:
        apart = values.reshape(1 + 2 * BESIDE, -1, self.joints).split([1] * (1 + 2 * BESIDE), axis=0)
        return [part.reshape(-1, self.joints) for part in apart]
