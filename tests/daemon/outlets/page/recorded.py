"""Recordings for the tests of what the page reads of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from cellwatt import Alarm, Event, Frames, Interval, Prediction
from cellwatt.record import Header
from cellwatt.record.encoder import Encoder, Item
from cellwatt.record.header import FileName
from cellwatt.record.openfile import OpenFile
from tests.blocks import frames_of, layout_of
from tests.daemon.record.making import write_chunks

S = 10**9
MS = 10**6
SESSION = 1_795_255_160 * S
CELL = "weld-3"
HEADER = Header("plant-1", CELL, SESSION)
STEP = 20 * MS


def frames(time: np.ndarray, values: np.ndarray, names: Sequence[str] = ("arm.power",), rate: float = 50.0) -> Frames:
    """A block of frames at some times, UTC ns."""
    values = np.asarray(values, float).reshape(len(time), len(names))
    return frames_of(layout_of(dict.fromkeys(names, "W"), rate), 0, time, values)


def alarm(name: str, since: int, time: int, active: bool = True, **more) -> Alarm:
    told = {"kind": "joint_fault", "severity": "error", "statement": f"{name} at {time}", **more}
    return Alarm(id=name, active=active, since=since, time=time, **told)


def event(kind: str, time: int, **data) -> Event:
    return Event(time, None, kind, kind, data)


def interval(number: int, start: int, end: int, moving: Sequence[int] = (1,), closed: bool = True) -> Interval:
    return Interval("arm", number, start, end, tuple(moving), (0.1,), (0.0,), (0.5,), closed)


def prediction(time: Sequence[int], model: str = "power", **outputs: Sequence[float]) -> Prediction:
    return Prediction(model, 0, tuple(time), {k: tuple(v) for k, v in outputs.items()}, dict.fromkeys(outputs, "W"))


class Written:
    """A recording that grows by chunks, as its writer leaves it on disk."""

    def __init__(self, folder: Path, number: int = 1, session: int = SESSION, cell: str = CELL) -> None:
        header = Header("plant-1", cell, session, number=number)
        self.file = OpenFile(folder / str(FileName(session, number, cell)), header)
        self._encoder = Encoder(self.file)

    def chunk(self, *items: Item) -> Written:
        for item in items:
            self._encoder.add(item)
        self.file.write_chunk()
        return self

    def close(self) -> Path:
        self.file.finish()
        self.file.publish()
        return self.file.path

    def crash(self) -> Path:
        self.file.release()
        return self.file.part


def recording(
    folder: Path, chunks: Iterable[Iterable[Item]], number: int = 1, session: int = SESSION, cell: str = CELL
) -> Path:
    """A closed recording whose chunks hold these items."""
    return write_chunks(folder, chunks, number=number, header=Header("plant-1", cell, session)).path
