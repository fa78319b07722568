"""Collects held poses from a running cell, and goes on where it stopped."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.files import COMPUTED, read_text
from cellwatt.frames import Frames, Layout
from cellwatt_plugins.models.static.held import STILL, HeldPose, Recogniser

Float = NDArray[np.float64]

NEAR: Final = 0.02
"""rad: a held pose is one of the plan where each joint is within this of it."""


@dataclass
class PoseFile:
    """A table of held poses that is whole on disk after each; ``joints`` is n, ``torque`` names the torque columns.

    Beside it, ``<file>.place`` keeps how far the cell's frames have been read.
    """

    path: Path
    joints: int
    torque: str
    rows: int = 0
    angles: list[Float] = field(default_factory=list)

    def __post_init__(self) -> None:
        joints = range(1, self.joints + 1)
        families = ("q", "q_from", self.torque, "torque_spread")
        self._columns = ["pose", "t", "count", *(f"{f}_{j}" for f in families for j in joints)]
        if self.path.exists():
            self._resume()
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._append([self._columns])
        except OSError as error:
            raise RecordingError(f"{self.path} cannot be written: {error.strerror}") from error

    def keep_place(self, place: dict[str, tuple[int, int]]) -> None:
        """Remember it for the next collection."""
        file = _place_file(self.path)
        partial = file.with_name(f".{file.name}.partial")
        partial.write_text(json.dumps(place))
        partial.replace(file)

    def add(self, pose: HeldPose) -> None:
        """One more pose, on disk when this returns."""
        spread = np.nan_to_num(pose.spread)
        before = ["" if np.isnan(way) else repr(float(q - way)) for q, way in zip(pose.q, pose.approach, strict=True)]
        values = [*pose.q.tolist(), *before, *pose.torque.tolist(), *spread.tolist()]
        self._append([[self.rows, pose.start * 1e-9, pose.count, *values]])
        self.rows += 1
        self.angles.append(pose.q)

    def _append(self, rows: Sequence[Sequence[object]]) -> None:
        with self.path.open("a", newline="") as file:
            csv.writer(file).writerows(rows)

    def _resume(self) -> None:
        header, *rows = [row for row in csv.reader(read_text(self.path, COMPUTED).splitlines()) if row] or [[]]
        if header != self._columns:
            raise RecordingError(
                f"{self.path}: has other columns than this collection: {', '.join(header[:4])} …; choose another file"
            )
        if rows and len(rows[-1]) < len(header):  # torn by a crash
            rows.pop()
            text = "".join(",".join(row) + "\r\n" for row in [header, *rows])
            self.path.write_text(text, newline="")
        self.rows = len(rows)
        first = header.index("q_1")
        self.angles = [np.array(row[first : first + self.joints], np.float64) for row in rows]


def place_of(path: Path) -> dict[str, tuple[int, int]]:
    """Return the place in the cell's frames that an earlier collection into a file reached; empty for a new one."""
    file = _place_file(path)
    if not (file.exists() and path.exists()):
        return {}
    return {topic: (int(session), int(number)) for topic, (session, number) in json.loads(read_text(file)).items()}


def _place_file(path: Path) -> Path:
    return path.with_name(f"{path.name}.place")


@dataclass(frozen=True)
class Progress:
    """Progress of a collection: ``held`` poses in the file, of which ``planned`` are different ones of the plan."""

    held: int
    planned: int
    total: int
    too_short: int


class Collector:
    """Takes the frames of a cell and keeps each pose that is held; ``plan`` (P, n) rad where there is one."""

    def __init__(self, layout: Layout, source: str | None, out: Path, plan: Float | None) -> None:
        self._layout = layout
        self._position = np.array(layout.joints("position", source))
        torque, name = _torque(layout, source)
        self._torque = np.array(torque)
        joints = len(self._position)
        if len(self._torque) != joints:
            raise ConfigError(f"{joints} joints have a position and {len(self._torque)} a torque: is it one arm?")
        if plan is not None and plan.shape[1] != joints:
            raise ConfigError(f"the plan is for {plan.shape[1]} joints, the arm has {joints}")
        self._recogniser = Recogniser(joints)
        self._plan = plan
        self.file = PoseFile(out, joints, name)
        self._met = np.zeros(0 if plan is None else len(plan), dtype=np.bool_)
        for q in self.file.angles:
            self._tick(q)

    def take(self, frames: Frames) -> Iterator[Progress]:
        """Poses that are complete with these frames. Raises ``RecordingError`` where the cell's channels changed."""
        if frames.layout.names != self._layout.names:
            raise RecordingError("the cell's channels have changed: start the collection again, it goes on")
        values = frames.values
        for pose in self._recogniser.update(frames.time, values[:, self._position], values[:, self._torque]):
            if self._again(pose):
                continue
            self.file.add(pose)
            self._tick(pose.q)
            yield self.progress

    @property
    def progress(self) -> Progress:
        """So far."""
        return Progress(self.file.rows, int(self._met.sum()), len(self._met), self._recogniser.too_short)

    def _again(self, pose: HeldPose) -> bool:
        """The last pose of an earlier collection, in which the arm still rests."""
        unmoved = bool(np.isnan(pose.approach).all()) and self.file.rows > 0
        return unmoved and bool(np.max(np.abs(pose.q - self.file.angles[-1])) < STILL)

    def _tick(self, q: Float) -> None:
        if self._plan is not None:
            self._met |= np.max(np.abs(self._plan - q), axis=1) < NEAR


def _torque(layout: Layout, source: str | None) -> tuple[tuple[int, ...], str]:
    """The columns of the torques, and what a table of poses calls them."""
    try:
        return layout.joints("torque", source), "torque"
    except ConfigError:
        return layout.joints("torque_ratio", source), "torque_ratio"
