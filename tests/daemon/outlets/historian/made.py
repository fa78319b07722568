"""A record with frames and results whose rows are known without the code under test."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt import FrameChannel, Frames, Layout
from cellwatt.results import Alarm, Energy, Task
from tests.blocks import frames_of, marked
from tests.daemon.outlets.page.recorded import CELL, Written

S = 10**9
SITE = "plant-1"
DAY = 86_400 * S
START = 1_795_219_200 * S  # a midnight
SESSION = START + 3600 * S
CHANNELS = (
    FrameChannel("arm.joint_1.position", "rad", "continuous", "linear"),
    FrameChannel("arm.bus.power", "W", "continuous", "average"),
    FrameChannel("arm.mode", "1", "discrete", "hold"),
)
LAYOUT = Layout(CHANNELS, 50.0)
ANOTHER = Layout((*CHANNELS, FrameChannel("mains.supply.power", "W", "continuous", "average")), 50.0)


def frames(first: int, count: int, session: int = SESSION, layout: Layout = LAYOUT) -> Frames:
    """Frames n: position n/7, power 100 + n, missing in the whole of each tenth second, mode n // 30.

    The first is 20 ms after the start of the session.
    """
    n = np.arange(first, first + count)
    power = np.where((n // 50) % 10 == 9, np.nan, 100.0 + n)
    values = np.column_stack([n / 7, power, n // 30, 2.0 * n][: len(layout.channels)])
    return frames_of(layout, first, session + (n + 1) * layout.step, values, marked(values))


def row_truth(second: int, session: int = SESSION) -> dict[str, Any]:
    """The row of a second (from 0) of a session, by hand."""
    n = np.arange(50 * second, 50 * second + 50)
    return {
        "time": session + (second + 1) * S,
        "sequence": 50 * second + 49,
        "arm.joint_1.position": float(np.mean(n / 7)),
        "arm.bus.power": None if second % 10 == 9 else float(np.mean(100.0 + n)),
        "arm.mode": float((50 * second + 49) // 30),
    }


def alarm(number: int, time: int, active: bool = True) -> Alarm:
    words, evidence = f"Joint {number}.", {"residual_W": float("nan"), "n": number}
    return Alarm(f"a{number}", "joint_fault", "error", active, time, time, words, "arm", number, evidence=evidence)


def task(number: int, end: int) -> Task:
    return Task("arm", "task_1", "abc", "speed=1.00", 1.0, end - 7 * S, end, (1, 2), number)


def energy(number: int, end: int) -> Energy:
    groups = {"mechanical_losses": 60.0 + number, "electronics": 40.0}
    return Energy("arm", "task_1", "speed=1.00", number, end - 7 * S, end, 100.0 + number, groups, 1.0, 50.0, 50.0)


class Recorded:
    """A record that grows by seconds, each a chunk with frames, and now and then a result."""

    def __init__(self, folder: Path, session: int = SESSION, layout: Layout = LAYOUT, second: int = 0) -> None:
        """A record that goes on at a second is another file of the session."""
        self.folder, self.session, self.layout = folder, session, layout
        self.number = 2 if second else 1
        self.second = second
        self._file: Written | None = None

    def seconds(self, count: int, results: bool = True) -> Recorded:
        if self._file is None:
            self._file = Written(self.folder, self.number, self.session)
        for second in range(self.second, self.second + count):
            block = frames(50 * second, 50, self.session, self.layout)
            at = self.session + second * S + S // 2
            more: Sequence[Any] = (
                (alarm(second, at), energy(second, at), task(second, at)) if results and second % 5 == 2 else ()
            )
            self._file.chunk(block, *more)
        self.second += count
        return self

    def rotate(self) -> Recorded:
        assert self._file is not None
        self._file.close()
        self._file, self.number = None, self.number + 1
        return self

    def close(self) -> None:
        if self._file is not None:
            self._file.crash()


__all__ = ["CELL", "LAYOUT", "SESSION", "Recorded", "frames", "row_truth"]
