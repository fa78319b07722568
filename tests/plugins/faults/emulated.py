"""Frames of the product's emulated arm."""

from __future__ import annotations

import numpy as np

from cellwatt.emulation import ArmSignals
from cellwatt.frames import FrameChannel, Frames, Layout
from tests.plugins.faults.plant import START


def arm_frames(signals: ArmSignals, seconds: float, *, rate: float = 50.0, block: int = 5) -> list[Frames]:
    """The arm's positions and its supply's power as blocks of frames from ``START`` on."""
    names = [f"joint_{j}.position" for j in range(1, 7)]
    channels = [FrameChannel(f"arm.{name}", "rad", "continuous", "linear") for name in names]
    layout = Layout((*channels, FrameChannel("board.supply.power", "W", "continuous", "average")), rate)
    t = np.arange(round(seconds * rate)) / rate
    columns = signals.at(t)
    values = np.column_stack([*(columns[name] for name in names), columns["supply.power"]])
    time = START + np.round(t * 1e9).astype(np.int64)
    blocks = []
    for i in range(0, len(t), block):
        part = values[i : i + block]
        quality, bound = np.zeros(part.shape, np.uint8), np.zeros(part.shape, np.int64)
        blocks.append(Frames(layout, i, time[i : i + block], part, quality, bound))
    return blocks
