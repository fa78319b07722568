"""From encoder pulses to joint angles, by the robot's settings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MotorAngles:
    """n joints: ``pulse`` (n,) rad per pulse, ``coupling`` (n, n) or ``None``, ``zero`` (n,) rad at pulse 0."""

    pulse: Float
    coupling: Float | None
    zero: Float

    @classmethod
    def of(
        cls,
        pulses_per_degree: Sequence[float],
        coupling: Sequence[Sequence[float]] | None = None,
        zero: Sequence[float] | None = None,
    ) -> MotorAngles:
        """From settings; ``zero`` in rad."""
        pulse = math.radians(1.0) / np.array(pulses_per_degree, dtype=np.float64)
        matrix = None if coupling is None else np.array(coupling, dtype=np.float64)
        return cls(pulse, matrix, np.zeros(len(pulse)) if zero is None else np.array(zero, dtype=np.float64))

    def angles(self, pulses: Sequence[int]) -> Float:
        """Joint angles (n,) rad from n pulses: coupling · (pulses × rad per pulse) + zero."""
        motors: Float = np.array(pulses, dtype=np.float64) * self.pulse
        joints: Float = (motors if self.coupling is None else self.coupling @ motors) + self.zero
        return joints
