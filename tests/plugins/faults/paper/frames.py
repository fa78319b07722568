"""What the plant tells, as the daemon's frames."""

from __future__ import annotations

from cellwatt.frames import Frames
from tests.plugins.faults.paper.irb1200 import Told
from tests.plugins.faults.plant import START, frames


def frames_of(told: Told, *, rate: float = 50.0, block: int = 10, start: int = START) -> list[Frames]:
    """Blocks of frames of a run at ``rate`` Hz whose time 0 is ``start`` ns."""
    return frames(told.q, told.power, rate=rate, block=block, start=start + round(told.t[0] * 1e9))
