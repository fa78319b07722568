"""Frames of 60 channels, and a cell that offers them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt import FrameChannel, Frames, Layout

SITE, CELL = "bench", "cell"
CHANNELS, RATE = 60, 50.0
QUANTITIES = {"position": "rad", "velocity": "rad/s", "torque": "Nm", "current": "A", "temperature": "degC"}
LAYOUT = Layout(
    tuple(
        FrameChannel(f"arm.joint_{i // 5 + 1}.{quantity}", unit, "continuous", "linear")
        for i, (quantity, unit) in enumerate(list(QUANTITIES.items()) * (CHANNELS // len(QUANTITIES)))
    ),
    RATE,
)
BLOCK = 25
"""Frames that are offered at a time."""
START = 1_800_000_000_000_000_000
"""ns UTC of the first frame."""


class View:
    """As much of a cell as an outlet needs, without a record."""

    site, cell = SITE, CELL
    folder = Path()
    record_folder = None
    session = 1
    journal = None

    def status(self) -> Mapping[str, Any]:
        return {"state": "green", "alarms": []}

    config = schema = status


def frames(first: int, count: int) -> Frames:
    """Frames ``first`` … ``first + count`` of the cell; a channel is never 0, nor the same twice in a row."""
    numbers = np.arange(first, first + count)
    values = np.sin((numbers[:, None] + 1) * np.linspace(0.01, 0.02, CHANNELS))
    shape = values.shape
    time = START + numbers * LAYOUT.step
    return Frames(LAYOUT, first, time, values, np.zeros(shape, np.uint8), np.zeros(shape, np.int64))
