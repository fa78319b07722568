"""Laws of friction: one formula each, for ``explain``, ``faults``, ``train power`` and ``disaggregate``.

A law is one file in this folder with a class derived from ``Friction``; nothing else names it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States


@dataclass(frozen=True)
class Sliding:
    """Motion that friction depends on: arrays (N,) or (N, n), or tensors of a graph that is exported."""

    qd: Any
    """rad/s."""
    sign: Any
    """Direction, -1 … 1, smooth about 0."""
    load: Any
    """Torque that the links need, Nm."""


class Friction(Effect):
    """A law of friction as a formula.

    ``explain`` tries its ``shapes``, as of every effect. The other users take the shapes declared here, if any.
    """

    of_motor = True
    trained: ClassVar[Mapping[str, Shape]] = {}
    """Shapes that ``train power`` tries, by their name in its report."""
    doubt: ClassVar[tuple[float, Shape] | None] = None
    """Share of a sound joint's friction that may follow this law (one standard deviation), and the shape:
    ``faults``."""
    split: ClassVar[tuple[float, Shape] | None] = None
    """Prior standard deviation of the coefficient, and the shape, with which ``disaggregate`` fits the law."""

    @abstractmethod
    def torque(self, sliding: Sliding, shape: Shape) -> Any:
        """Torque against the motion, Nm for a coefficient of 1; numpy's operators and ufuncs only."""

    def shown(self, shape: Shape, slowest: float, fastest: float) -> bool:
        """Return whether a motion that resolves velocities from ``slowest`` to ``fastest`` rad/s shows this law."""
        return True

    def columns(self, run: States, joint: int | None, shape: Shape) -> Float:
        sliding = Sliding(run.qd[:, joint], run.sign[:, joint], run.load[:, joint])
        return np.asarray(self.torque(sliding, shape))[:, None]
