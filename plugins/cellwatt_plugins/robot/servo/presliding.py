"""Friction that builds up after a reversal, as motion alone shows it."""

from __future__ import annotations

from collections.abc import Sequence

from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.friction.presliding_hysteresis import SLOW, PreslidingHysteresis
from cellwatt_plugins.robot.effects.states import States

SLOWEST = 0.1
"""rad/s: what turns over within less may be how the simulator softens friction at a stop; see ``TURNOVERS``."""


class BuiltUp(PreslidingHysteresis):
    """The same law where it goes with the way, or with speeds that no simulator softens friction within."""

    def resolved(self, runs: Sequence[States], joint: int | None, shape: Shape) -> bool:
        return super().resolved(runs, joint, shape) and (shape[0] != SLOW or shape[1] > SLOWEST)
