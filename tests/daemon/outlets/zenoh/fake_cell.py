"""A cell without a daemon: streams, batches, frames and results with known contents, and a record in memory."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cellwatt import Alarm, AlarmBook, Batch, Channel, Frames, Stream
from cellwatt.frames import Block, cut
from cellwatt.results import Event, Result, Task, series_of
from tests.blocks import layout_of

SITE, CELL = "plant-1", "weld-3"
EPOCH = 1_800_000_000_000_000_000
STREAM = Stream(
    "samples",
    (Channel("joint_1.position", "rad"), Channel("supply.power", "W"), Channel("mode", "1", "discrete")),
    500.0,
    "device",
)
HOST_STREAM = Stream("meter", (Channel("supply.power", "W"),), 10.0, "host")
LAYOUT = layout_of({"arm.joint_1.position": "rad", "arm.supply.power": "W"})


STATUS: Mapping[str, Any] = {
    "site": SITE,
    "cell": CELL,
    "state": "green",
    "time": EPOCH,
    "sources": {},
    "recorder": None,
    "frames": {"count": 0},
    "results": 0,
}


def batch(first: int, count: int, source: str = "arm", stream: Stream = STREAM, arrival: int | None = None) -> Batch:
    """Samples whose every value says which sample it is."""
    numbers = np.arange(first, first + count)
    width = len(stream.channels)
    return Batch(
        source=source,
        stream=stream,
        sequence=first,
        arrival=EPOCH + first if arrival is None else arrival,
        time=EPOCH + numbers * 2_000_000,
        bound=numbers % 1000,
        values=numbers[:, None] + np.arange(width) / 10,
        quality=(numbers % 5).astype(np.uint8),
        device_time=numbers * 2_000_000 if stream.clock == "device" else None,
    )


def frames(first: int, count: int) -> Frames:
    numbers = np.arange(first, first + count)
    return Frames(
        layout=LAYOUT,
        sequence=first,
        time=EPOCH + numbers * LAYOUT.step,
        values=numbers[:, None] + np.array([0.25, np.nan]),
        quality=np.column_stack([numbers % 2, np.full(count, 4)]).astype(np.uint8),
        bound=np.column_stack([numbers, numbers + 1]),
    )


def alarm(number: int, active: bool = True, **more: Any) -> Alarm:
    about: dict[str, Any] = {
        "id": f"alarm-{number}",
        "kind": "joint_fault",
        "severity": "error",
        "active": active,
        "since": EPOCH,
        "time": EPOCH + number * 1_000_000,
        "statement": f"Joint {number} needs more power than it should.",
        "source": "arm",
        "stage": "faults",
        "joint": number,
        "evidence": {"residual_W": 12.5},
    }
    return Alarm(**{**about, **more})


def task(number: int) -> Task:
    end = EPOCH + number * 10**9
    return Task("arm", "task_1", "c0ffee", "speed=1.00", 1.0, end - 10**9, end, (number,), number)


def sample(payload: bytes, attachment: bytes) -> Any:
    """A message as Zenoh gives it."""

    def holding(data: bytes) -> Any:
        return SimpleNamespace(to_bytes=lambda: data)

    return SimpleNamespace(payload=holding(payload), attachment=holding(attachment))


class Journal:
    """What was published in this session, numbered by series."""

    def __init__(self, *items: Result | Event) -> None:
        self.items = list(items)

    def put(self, item: Result | Event) -> int:
        self.items.append(item)
        return self._number(len(self.items) - 1)

    def past(self) -> Iterator[tuple[int, Result | Event]]:
        return iter([(self._number(place), item) for place, item in enumerate(self.items)])

    def _number(self, place: int) -> int:
        return sum(series_of(item) == series_of(self.items[place]) for item in self.items[:place])


class FakeView:
    """A ``CellView`` whose record is in memory. ``lag``: samples at the end that are not on disk yet."""

    site = SITE
    journal = None
    folder = Path("/")

    def __init__(self, session: int = EPOCH, cell: str = CELL, record_folder: Path | None = None) -> None:
        self.session, self.cell, self.record_folder = session, cell, record_folder
        self.alarms = AlarmBook()
        self.lag = 0
        self.forgotten = 0
        self._lock = threading.Lock()
        self._recorded: dict[tuple[int, str, str], list[Batch]] = {}
        self._frames: dict[int, list[Frames]] = {}

    def record(self, item: Batch | Frames, session: int | None = None) -> None:
        session = session or self.session
        with self._lock:
            if isinstance(item, Frames):
                self._frames.setdefault(session, []).append(item)
            else:
                self._recorded.setdefault((session, item.source, item.stream.name), []).append(item)

    def status(self) -> Mapping[str, Any]:
        return STATUS

    def config(self) -> Mapping[str, Any]:
        record = None if self.record_folder is None else {"frames": True}
        return {"site": SITE, "cell": CELL, "password": "${SECRET}", "record": record}

    def schema(self) -> Mapping[str, Any]:
        return {"streams": {"arm": {"samples": list(STREAM.names)}}}

    def recordings(self) -> Sequence[Mapping[str, Any]]:
        with self._lock:
            sessions = sorted({session for session, _, _ in self._recorded})
        return [{"file": f"{session}.mcap", "session": session, "state": "closed"} for session in sessions]

    def history(self, source: str, stream: str, session: int, first: int, count: int) -> Sequence[Batch]:
        with self._lock:
            return self._kept(self._recorded.get((session, source, stream), ()), first, count)

    def frame_history(self, session: int, first: int, count: int) -> Sequence[Frames]:
        with self._lock:
            return self._kept(self._frames.get(session, ()), first, count)

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        return []

    def _kept(self, blocks: Sequence[Block], first: int, count: int) -> list[Block]:
        end = (blocks[-1].sequence + len(blocks[-1]) - self.lag) if blocks else 0
        begin, end = max(first, self.forgotten), min(max(first, self.forgotten) + count, end)
        return [
            cut(b, begin - b.sequence, end - b.sequence)
            for b in blocks
            if b.sequence < end and b.sequence + len(b) > begin
        ]
