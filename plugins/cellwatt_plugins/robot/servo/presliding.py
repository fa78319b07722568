"""Friction that builds up after a reversal, as motion alone shows it."""

from __future__ import annotations

from collections.abc import Sequence

from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.friction.presliding_hysteresis import SLOW, PreslidingHysteresis
from cellwatt_plugins.robot.effects.states import States

SLOWEST = 0.1
"""rad/s: a build-up within less may be how the simulator softens friction at a stop; see ``TURNOVERS``."""


class BuiltUp(PreslidingHysteresis):
    """The same law, over a displacement, or over speeds within which no simulator softens friction."""

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        return super().resolved(runs, joint, shape) and (shape[0] != SLOW or shape[1] > SLOWEST)
