"""What a local scheduler costs: its start, each task, each byte."""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from cellwatt.scheduler import scheduled, spread

TASKS = 300
SIZE = 1_000_000
HEAVY = 100


@dataclass(frozen=True)
class Overheads:
    """Seconds."""

    start: float
    """From the command to the first result of a worker."""
    task: float
    byte: float
    """To a worker and back, two ways counted."""


def nothing(item: int) -> int:
    """Return the item."""
    return item


def same(item: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the item."""
    return item


def measure(workers: int, repeats: int = 3) -> Overheads:
    """Medians over some clusters."""
    starts, tasks, sent = [], [], []
    for _ in range(repeats):
        begun = time.monotonic()
        with scheduled(f"local:{workers}"):
            spread(nothing, range(workers * 2), "starting")
            ready = time.monotonic()
            spread(nothing, range(TASKS), "tasks")
            light = time.monotonic()
            spread(same, [np.ones(SIZE // 8)] * HEAVY, "bytes")
            heavy = time.monotonic()
        starts.append(ready - begun)
        tasks.append((light - ready) / TASKS)
        sent.append(max(heavy - light - HEAVY * tasks[-1], 0.0) / (2 * SIZE * HEAVY))
    return Overheads(median(starts), median(tasks), median(sent))
