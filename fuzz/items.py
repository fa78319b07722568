"""Small items of every kind, for seeds."""

from __future__ import annotations

import numpy as np

from cellwatt.batch import Batch, Tick
from cellwatt.channel import Channel, Stream
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.record.messages import Health, Message
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Task

SESSION = 1_795_255_163_290_084_047
STREAM = Stream("rtde", (Channel("joint_1.position", "rad"), Channel("bus.power", "W", window=0.1)), 500.0, "device")
LAYOUT = Layout(tuple(FrameChannel(f"arm.{c.name}", c.unit, c.kind, c.method, c.window) for c in STREAM.channels), 50.0)
NAN = float("nan")

MESSAGES: tuple[Message, ...] = (
    Tick(SESSION),
    Event(SESSION, "arm", "connected", "arm: connected", {"rate": 500.0}),
    Interval("arm", 3, SESSION, SESSION + 9, (1,), (0.5, NAN), (0.0, 1.0), (1.0, 0.0)),
    Task("arm", "task_1", "1+52", "speed=1.00", 1.0, SESSION, SESSION + 9, (1, 2, 3), 4),
    Energy("arm", "task_1", "speed=1.00", 4, SESSION, SESSION + 9, 100.0, {"copper": 20.0, "unexplained": NAN}, 3.0,
           50.0, 50.0),
    Prediction("power", 7, (SESSION,), {"supply.power": (300.0,)}, {"supply.power": "W"}),
    Alarm("a1", "joint_fault", "error", True, SESSION, SESSION + 1, "joint 3", "arm", 3, (2,), 5, {"excess_W": 40.0}),
    Health(SESSION, {"state": "ok"}),
)  # fmt: skip


def batch(first: int, n: int, device: bool = True) -> Batch:
    """Samples of ``STREAM``."""
    sequence = np.arange(first, first + n)
    values = np.stack([sequence * 0.5, np.where(sequence % 3, 20.0, NAN)], axis=1)
    return Batch(
        source="arm",
        stream=STREAM,
        sequence=first,
        arrival=SESSION + 2_000_000 * (first + n),
        time=SESSION + 2_000_000 * sequence,
        bound=1000 + sequence,
        values=values,
        quality=(sequence % 5).astype(np.uint8),
        device_time=2_000_000 * sequence if device else None,
    )


def frames(first: int, n: int) -> Frames:
    """Frames of ``LAYOUT``."""
    sequence = np.arange(first, first + n)
    return Frames(
        layout=LAYOUT,
        sequence=first,
        time=SESSION + 20_000_000 * sequence,
        values=np.stack([sequence * 0.5, sequence * 2.0], axis=1),
        quality=np.zeros((n, 2), np.uint8),
        bound=np.full((n, 2), 700),
    )


def same(one: object, other: object) -> bool:
    """Whether two items are the same to the last bit."""
    if not isinstance(one, Batch | Frames):
        return type(one) is type(other) and str(one) == str(other)
    if type(one) is not type(other):
        return False
    for name in one.__dataclass_fields__.keys() - {"rows"}:  # what a ring holds, beside what it holds it for
        a, b = getattr(one, name), getattr(other, name)
        if isinstance(a, np.ndarray):
            if not isinstance(b, np.ndarray) or a.dtype != b.dtype or a.tobytes() != b.tobytes():
                return False
        elif a != b:
            return False
    return True
