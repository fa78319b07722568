"""A recording of one arm on an even grid: encoder positions and supply power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt_plugins.faults.trace import one_layout
from cellwatt_plugins.robot.meter.held import held
from cellwatt_plugins.robot.meter.model import Meter, Readings
from cellwatt_plugins.robot.samples import Even

LONGEST_HOLE = 0.5
"""Longest hole in the positions that is interpolated, s; in longer ones the pose is unknown."""
LONGEST_PAUSE = 60.0
"""Length to which longer holes are cut, s, so that files of several days fit into memory."""


@dataclass(frozen=True)
class Recording(Even):
    """``time`` (N,) s on an even grid, ``position`` (N, n) rad, ``power`` (N,) W; NaN in power where missing.

    ``position`` of a prismatic joint is in m as recorded; once ``in_angles``, 1 rad stands for a travel of its lever.
    """

    time: Float
    position: Float
    power: Float
    meter: Meter | None = None
    """The slow meter that measured the power; None if the power was sampled."""
    unknown: NDArray[np.bool_] | None = None
    """True (N,) for samples in holes of the positions too long to interpolate; None: no such samples."""
    pauses: tuple[tuple[float, float], ...] = ()
    """For each hole cut to ``LONGEST_PAUSE``: the ``time`` of its end, s, and the time cut out of it, s."""

    def in_angles(self, levers: Float) -> Recording:
        """The recording with all positions in rad; see ``Body.levers``."""
        return replace(self, position=self.position / levers)

    def clock(self, time: float) -> float:
        """Clock time at ``time`` s, holes uncut."""
        return time + sum(more for begin, more in self.pauses if time >= begin)

    @cached_property
    def readings(self) -> Readings | None:
        """The values of the slow meter, each once; None without a slow meter."""
        return None if self.meter is None else self.readings_every(self.meter.interval)

    def readings_every(self, interval: float | None) -> Readings | None:
        """The values of a slow meter with this ``interval`` (s), or with any; None if power is not held from one."""
        known = ~np.isnan(self.power)
        if known.sum() < 2:
            return None
        # A hole holds the value before it; a new value counts from the end of the hole.
        last = np.maximum.accumulate(np.where(known, np.arange(len(known)), np.argmax(known)))
        found = held([(self.time, self.power[last])], interval)
        return None if found is None else found[0]

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return int(self.position.shape[1])


def recording_of(blocks: Sequence[Frames], arm: str | None, power: str) -> Recording:
    """Recording of one arm with the power channel ``power``; holes in the positions are interpolated, long ones marked.

    Raises ``RecordingError`` if no frame has the positions of all joints.
    """
    layout = one_layout(blocks)
    time = np.concatenate([block.time for block in blocks])
    values = np.concatenate([block.values for block in blocks])
    steps = np.diff(time)
    cut = np.where(steps > LONGEST_PAUSE * 1e9, steps - round(LONGEST_PAUSE * 1e9 / layout.step) * layout.step, 0)
    time[1:] -= np.cumsum(cut)
    pauses = tuple((float(time[k + 1] * 1e-9), float(cut[k] * 1e-9)) for k in np.flatnonzero(cut).tolist())
    grid = np.arange(time[0], time[-1] + 1, layout.step)
    row = np.clip(np.searchsorted(time, grid), 0, len(time) - 1)
    positions = values[:, list(layout.joints("position", arm))]
    known = ~np.isnan(positions).any(axis=1)
    if known.sum() < 2:
        raise RecordingError("no position of all joints in these recordings")
    there = time[known]
    bridged = [np.interp(grid, there, column[known]) for column in positions.T]
    watts = np.where(time[row] == grid, values[row, layout.index(power, "W")], np.nan)
    after = np.clip(np.searchsorted(there, grid), 1, len(there) - 1)
    inside = (grid > there[after - 1]) & (grid < there[after])
    unknown = inside & (np.diff(there)[after - 1] > LONGEST_HOLE * 1e9)
    unknowns = unknown if unknown.any() else None
    return Recording(grid * 1e-9, np.column_stack(bridged), watts, unknown=unknowns, pauses=pauses)
