"""Frames of a moving arm with noise on all channels, and records of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.emulation import ArmSignals
from cellwatt.record import Header
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import FileName
from cellwatt.record.openfile import OpenFile

S = 10**9
SESSION = 1_795_255_200 * S
SITE, CELL = "bench", "cell"


def layout(channels: int, rate: float) -> Layout:
    """Frames of ``channels`` continuous channels at ``rate`` Hz."""
    return Layout(tuple(FrameChannel(f"arm.value_{i}", "1", "continuous", "linear") for i in range(channels)), rate)


def values(count: int, channels: int, rate: float, seed: int = 0) -> NDArray[np.float64]:
    """(count, channels) of arms at work, each with noise of its own."""
    columns: list[NDArray[np.float64]] = []
    while len(columns) < channels:
        columns += ArmSignals(seed=seed + len(columns)).at(np.arange(count) / rate).values()
    return np.column_stack(columns[:channels])


def minutes(folder: Path, channels: int, rate: float, length: float = 10.0) -> None:
    """A recording of frames alone, a chunk a second."""
    shape, each = layout(channels, rate), max(1, round(rate))
    file = OpenFile(folder / str(FileName(SESSION, 1, CELL)), Header(SITE, CELL, SESSION, number=1))
    encoder, table = Encoder(file), values(round(60 * length * rate), channels, rate)
    for first in range(0, len(table), each):
        block = table[first : first + each]
        time = SESSION + np.arange(first, first + len(block)) * shape.step
        zeros = np.zeros(block.shape)
        encoder.add(Frames(shape, first, time, block, zeros.astype(np.uint8), zeros.astype(np.int64)))
        file.write_chunk()
    file.finish()
    file.publish()
