"""A stretch of one arm on an even grid: encoders and supply power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt_plugins.faults.trace import one_layout
from cellwatt_plugins.robot.meter.held import held
from cellwatt_plugins.robot.meter.model import Meter, Readings

LONGEST_HOLE = 0.5
"""s of missing positions up to which they are bridged; where the arm was meanwhile is not known in longer ones."""
LONGEST_PAUSE = 60.0
"""s that longer holes are taken to last: files of several days must fit into memory."""


@dataclass(frozen=True)
class Recording:
    """``time`` (N,) s on an even grid, ``position`` (N, n) rad, ``power`` (N,) W; NaN in power where missing."""

    time: Float
    position: Float
    power: Float
    meter: Meter | None = None
    """The slow meter that power is from."""
    unknown: NDArray[np.bool_] | None = None
    """Samples (N,) in holes of the positions that are too long to be bridged; None: there are none."""
    pauses: tuple[tuple[float, float], ...] = ()
    """``time`` from which clocks showed so many s more, for each hole that was cut to ``LONGEST_PAUSE``."""

    def clock(self, time: float) -> float:
        """What clocks showed at ``time`` s."""
        return time + sum(more for begin, more in self.pauses if time >= begin)

    @cached_property
    def readings(self) -> Readings | None:
        """The values of a slow meter, each once; None where power is not from one."""
        return None if self.meter is None else self.readings_every(self.meter.interval)

    def readings_every(self, interval: float | None) -> Readings | None:
        """The values of a slow meter of one every ``interval`` s, or of any; None where power is not from one."""
        known = ~np.isnan(self.power)
        if known.sum() < 2:
            return None
        # A hole holds the value before it: what comes with its end counts from there.
        last = np.maximum.accumulate(np.where(known, np.arange(len(known)), np.argmax(known)))
        found = held([(self.time, self.power[last])], interval)
        return None if found is None else found[0]

    @property
    def step(self) -> float:
        """Grid step, s."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return int(self.position.shape[1])


def recording_of(blocks: Sequence[Frames], arm: str | None, power: str) -> Recording:
    """The frames of one arm with the power channel ``power``; holes in positions are bridged, long ones are told.

    Raises ``RecordingError`` where there is nothing to judge.
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
    watts = np.where(time[row] == grid, values[row, layout.index(power)], np.nan)
    after = np.clip(np.searchsorted(there, grid), 1, len(there) - 1)
    inside = (grid > there[after - 1]) & (grid < there[after])
    unknown = inside & (np.diff(there)[after - 1] > LONGEST_HOLE * 1e9)
    unknowns = unknown if unknown.any() else None
    return Recording(grid * 1e-9, np.column_stack(bridged), watts, unknown=unknowns, pauses=pauses)
