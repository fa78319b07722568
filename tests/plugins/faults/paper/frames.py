"""What the plant tells, as the daemon's frames."""

from __future__ import annotations

import numpy as np

from cellwatt.frames import FrameChannel, Frames, Layout
from tests.plugins.faults.paper.irb1200 import Told
from tests.plugins.faults.plant import START


def frames_of(told: Told, *, rate: float = 50.0, block: int = 10, start: int | None = None) -> list[Frames]:
    """Blocks of frames from ``start`` ns on, of a run at ``rate`` Hz."""
    names = [f"joint_{j}.position" for j in range(1, 7)]
    channels = [FrameChannel(f"arm.{name}", "rad", "continuous", "linear") for name in names]
    layout = Layout((*channels, FrameChannel("board.supply.power", "W", "continuous", "average")), rate)
    values = np.column_stack([told.q, told.power])
    time = (START if start is None else start) + np.round(told.t * 1e9).astype(np.int64)
    out = []
    for i in range(0, len(time), block):
        part = values[i : i + block]
        quality, bound = np.zeros(part.shape, np.uint8), np.zeros(part.shape, np.int64)
        out.append(Frames(layout, i, time[i : i + block], part, quality, bound))
    return out
