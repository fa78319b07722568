"""A cell like the demo's without a daemon: what it tells, once, in the order in which it is told."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cellwatt import Alarm, Frames
from cellwatt.results import Energy, Event, Interval, Prediction, Result, Task
from tests.blocks import layout_of
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, STATUS

UNITS = {
    **{f"arm.joint_{i}.position": "rad" for i in range(1, 7)},
    **{f"arm.joint_{i}.current": "A" for i in range(1, 7)},
    "arm.bus.power": "W",
    "board.supply.power": "W",
}
LAYOUT = layout_of(UNITS)
HEALTH: Final[dict[str, Any]] = {**STATUS, "state": "amber"}
FRAMES: Final = 12


def frames(first: int = 0, count: int = FRAMES) -> Frames:
    """Frames with other values in each place; the supply's power is missing in the first."""
    numbers = np.arange(first, first + count)
    values = np.sin(numbers[:, None] * 0.37 + np.arange(len(UNITS)))
    values[numbers == 0, -1] = np.nan
    return Frames(
        layout=LAYOUT,
        sequence=first,
        time=EPOCH + numbers * LAYOUT.step,
        values=values,
        quality=np.where(np.isnan(values), 4, 0).astype(np.uint8),
        bound=np.tile(numbers[:, None] + 7, len(UNITS)),
    )


def alarm(number: int, severity: Any, active: bool = True, residual: float = 12.5) -> Alarm:
    at, words = EPOCH + (1000 if active else 2000) + number, f"Joint {number} needs more power."
    figures = {"residual_W": residual}
    return Alarm(f"a.{number}", "joint_fault", severity, active, EPOCH, at, words, "arm", number, evidence=figures)


STEP = LAYOUT.step
TOLD: Final[list[Result | Event]] = [
    Interval("arm", 3, EPOCH, EPOCH + 5 * STEP, (1, 4), (0.5, 0.0), (0.1, 0.2), (1.0, 0.0)),
    Task("arm", "task_1", "sig", "speed=0.60", 0.6, EPOCH, EPOCH + 6 * STEP, (1, 2, 3), 2),
    Energy("arm", "task_1", "speed=0.60", 2, EPOCH, EPOCH + 6 * STEP, 250.0, {"friction": 100.0}, 4.0, 90.0, 36.0),
    Prediction("power", 0, (EPOCH, EPOCH + STEP), {"power": (301.5, 302.5)}, {"power": "W"}),
    alarm(1, "error"),
    alarm(1, "error", residual=13.0),
    alarm(2, "warning"),
    alarm(3, "info"),
    alarm(2, "warning", active=False),
    Event(EPOCH + 5000, "board", "connected", "The power board is there.", {"serial": "x1"}),
    Event(EPOCH + 6000, None, "reloaded", "The settings were read again."),
]
LOGGED: Final = [
    (4, "Joint 1 needs more power.", "arm"),
    (3, "Joint 2 needs more power.", "arm"),
    (2, "Joint 3 needs more power.", "arm"),
    (2, "Joint 2 needs more power.", "arm"),
    (2, "The power board is there.", "board"),
    (2, "The settings were read again.", "cellwatt"),
]
"""Lines of the log: level as ``foxglove.Log`` counts it, text, name."""
