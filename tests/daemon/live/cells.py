"""A cell whose every figure is known, as its messages tell it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellwatt import Alarm, Energy, Frames, Interval, Prediction, Task
from cellwatt.live.state import LiveCell
from cellwatt.subscriber import Gap, Health, Message
from tests.blocks import frames_of, layout_of

SECOND = 10**9
START = 1_700_000_000 * SECOND
"""22:13:20 UTC."""
JOINTS, METERS = ("arm.joint_1.position", "arm.joint_2.position"), ("board.supply.power", "mains.supply.power")
LAYOUT = layout_of(dict.fromkeys(JOINTS, "rad") | dict.fromkeys(METERS, "W"), 10.0)
GROUPS = {"brakes": 5.5, "electronics": 60.0, "stored": 0.0, "regeneration": 0.25, "unexplained": -0.75}


def hear(cell: LiveCell, message: Message) -> None:
    """Tell a cell what a subscriber got."""
    content = message.content
    if isinstance(content, Frames):
        cell.add_frames(content)
    elif isinstance(content, Health):
        cell.add_health(content.status, content.session)
    else:
        cell.add(content)


def source(state: str = "ok", error: str | None = None, lost: int = 0) -> dict[str, Any]:
    return {
        "state": state,
        "error": error,
        "expected": 1000,
        "received": 1000 - lost,
        "missed": {"late": lost},
        "dropped": {},
    }


def status(**more: Any) -> dict[str, Any]:
    sources = {"arm": source(), "board": source()}
    told = {"site": "plant-1", "cell": "weld-3", "state": "green", "time": START, "recorder": None}
    return {**told, "frames": {"count": 7}, "results": 3, "sources": sources, **more}


def health(session: int = 1, **more: Any) -> Message:
    return Message("health", session, 0, False, Health(session, START, {}, status(**more)))


def frames(first: int, power: Any) -> Message:
    """Frames every 0.1 s from the ``first`` one on; joint 1 counts them, the mains draw 300 W more than the board."""
    count = np.arange(first, first + len(power))
    values = np.column_stack([count, -count, power, np.add(power, 300.0)]).astype(float)
    return Message("frame", 1, first, False, frames_of(LAYOUT, first, START + LAYOUT.step * count, values))


def prediction(first: int, power: Any) -> Message:
    times = tuple((START + LAYOUT.step * np.arange(first, first + len(power))).tolist())
    said = Prediction("model", first, times, {"power": tuple(power)}, {"power": "W"})
    return Message("prediction/model", 1, first, False, said)


def interval(number: int, moving: tuple[int, ...], seconds: float, closed: bool = True) -> Message:
    end = START + round(seconds * SECOND)
    content = Interval("arm", number, START, end, moving, (0.0,), (0.0,), (0.0,), closed)
    return Message("interval", 1, number, False, content)


def task(repetition: int) -> Message:
    content = Task("arm", "task_1", "1-2", "speed=1.00", 1.0, START, START + 9 * SECOND, (1, 2), repetition)
    return Message("task", 1, repetition, False, content)


def energy(repetition: int, total: float = 65.0, **more: Any) -> Message:
    content = Energy("arm", "task_1", "speed=1.00", repetition, 0, repetition, total, GROUPS, 0.5, 9.0, 13.8, **more)
    return Message("energy", 1, repetition, False, content)


def alarm(name: str, active: bool = True, **more: Any) -> Message:
    told: dict[str, Any] = {"severity": "error", "statement": f"{name} is wrong.", "joint": 3, "alternatives": (2,)}
    told |= {"since": START, "time": START + SECOND, "evidence": {"residual_W": 12.5}, **more}
    return Message("alarm", 1, 0, False, Alarm(name, "joint_fault", active=active, **told))


def gap(count: int) -> Message:
    return Message("raw/arm/main", 1, 0, True, Gap(count, "no longer kept"))
