"""The robot behind an emulated controller: signals as the controller's counts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.emulation import Signals
from cellwatt.emulation.blocks import Blocks
from cellwatt.emulation.signals import table_of
from cellwatt_drivers.yaskawa import payload

PULSES_PER_DEGREE = (1341.4, 1341.4, 1341.4, 1000.0, 1000.0, 622.0)
"""Pulses per degree as published for an MH24 on DX200."""
RATED_TORQUE = (120.0, 120.0, 60.0, 15.0, 15.0, 10.0)
"""Nm at the joint at 100 %."""

_CYCLE = 0.004  # s; an answer holds the values of the controller's last cycle
_BLOCK = 25  # cycles computed at once
_POSE = ("x", "y", "z", "rx", "ry", "rz")
_POSE_COUNTS = np.array([1 / payload.METRES] * 3 + [1 / math.radians(payload.DEGREES)] * 3)

Counts = NDArray[np.int32]


AXES = 8
"""Axes in an answer."""


class EmulatedRobot:
    """Gives pulses, torque counts (whole per cent of the rated torque) and the tool's pose at a time.

    An answer has ``AXES``; joints that the signals lack are 0.
    """

    def __init__(self, signals: Signals, pulses_per_degree: Sequence[float], rated_torque: Sequence[float]) -> None:
        if not 0 < len(pulses_per_degree) == len(rated_torque) <= AXES:
            raise ValueError(f"pulses_per_degree and rated_torque need the same number of values, up to {AXES}")
        self.axes = len(pulses_per_degree)
        self._signals = signals
        self._pulses = np.degrees(1.0) * np.asarray(pulses_per_degree)
        self._counts = 100.0 / np.asarray(rated_torque)
        self._blocks = Blocks(self._compute, _CYCLE, _BLOCK)

    def pulses(self, t: float) -> tuple[int, ...]:
        """Encoder pulses of all axes of an answer at t s."""
        return self._row(0, t)

    def torques(self, t: float) -> tuple[int, ...]:
        """Torque counts of all axes of an answer at t s."""
        return self._row(1, t)

    def pose(self, t: float) -> tuple[int, ...]:
        """Tool pose in µm and 1e-4 degrees at t s; zero unless the signals have ``tool.x`` … ``tool.rz``."""
        return self._row(2, t)

    def _row(self, table: int, t: float) -> tuple[int, ...]:
        tables, row = self._blocks.at(math.floor(t / _CYCLE))
        counts: list[int] = tables[table][row].tolist()
        return tuple(counts)

    def _compute(self, t: Float) -> tuple[Counts, Counts, Counts]:
        values = self._signals.at(t)

        def table(names: Sequence[str], scale: NDArray[np.float64]) -> Counts:
            counts = np.zeros((len(t), AXES), np.int32)
            counts[:, : len(names)] = np.rint(table_of(values, names, len(t)) * scale)
            return counts

        joints = [f"joint_{joint}" for joint in range(1, self.axes + 1)]
        return (
            table([f"{joint}.position" for joint in joints], self._pulses),
            table([f"{joint}.torque" for joint in joints], self._counts),
            table([f"tool.{axis}" for axis in _POSE], _POSE_COUNTS),
        )
