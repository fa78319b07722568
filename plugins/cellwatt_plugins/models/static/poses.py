"""Held poses, one row each, from tables and recordings."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from cellwatt.arrays import Float, Nanoseconds, joined, rows_of
from cellwatt.errors import RecordingError
from cellwatt.scheduler import spread
from cellwatt.tables import read_table
from cellwatt_plugins.models.static.held import held, turned
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.samples import torque_in, unpowered

FEWEST: Final = 12
"""Fewest poses for a training."""
_LIGHT: Final = 0.05  # kg: payloads that differ by less do not show a payload's effect
_ALIKE: Final = 1e-3  # rad: poses in which no joint differs by more are one
_SHORT: Final = 0.25
"""Poses with less than this share of the usual number of samples are left out."""


@dataclass(frozen=True)
class Poses:
    """N held poses of an arm with n joints."""

    q: Float
    """(N, n) rad."""
    torque: Float
    """(N, n) Nm at the joint, mean over the pose."""
    approach: Float
    """(N, n) rad, the last movement of each joint towards the pose; NaN if unknown."""
    payload: Float
    """(N,) kg at the tool beside the arm's permanent load; NaN if unknown."""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.q)

    @property
    def payload_known(self) -> bool:
        """True if poses with different payloads show a payload's effect."""
        known = self.payload[np.isfinite(self.payload)]
        return bool(len(known) and np.ptp(known) > _LIGHT)

    @property
    def total(self) -> Float:
        """Sum of absolute torques (N,) Nm; eq. 5 of the paper."""
        return np.asarray(np.sum(np.abs(self.torque), axis=1))

    @property
    def digest(self) -> str:
        """SHA-256 of the data that a model may be trained on."""
        parts = (self.q, self.torque, self.approach, self.payload[:, None])
        return hashlib.sha256(np.hstack(parts).astype("<f8").tobytes()).hexdigest()


def read_poses(paths: Sequence[Path], robot: RobotDescription) -> Poses:
    """The poses of all files in the order given.

    A table has a column ``pose`` with one row per sample, or one per pose, in the order in which the poses were
    visited; or plain rows ``t``, ``q_i`` and torques, in which poses are recognised, as in recordings of cellwatt.

    Raises ``RecordingError``.
    """
    return _joined(spread(_read, paths, "reading recordings", shared=robot), paths)


def _read(path: Path, robot: RobotDescription) -> Poses:
    table = read_table(path, robot.names)
    q = table.needed("position", len(robot.joints))
    torque = torque_in(table, robot)
    known = np.isfinite(q) & np.isfinite(torque)
    whole = known.all(axis=1)
    if not whole.any():
        dead = ", ".join(robot.joints[j].name for j in np.flatnonzero(~known.any(axis=0)))
        raise RecordingError(
            f"{path}: no row has positions and torques of all joints" + (f": there are none of {dead}" if dead else "")
        )
    number = table.channel("pose") if "pose" in table.names else None
    payload = table.whole("tool.payload")
    payload = np.full(len(q), np.nan) if payload is None else payload
    if number is not None:
        before = np.full_like(q, np.nan) if table.joints("came_from") is None else table.needed("came_from", q.shape[1])
        poses = _grouped(*(each[whole] for each in (number, q, torque, before, payload)))
    elif table.clock is None:
        raise RecordingError(f"{path}: expected a column pose, or t (s) with the arm's motion in between")
    else:
        poses = _recognised(np.rint(table.time[whole] * 1e9).astype(np.int64), q[whole], torque[whole], payload[whole])
    if not len(poses):
        raise RecordingError(f"{path}: no pose was held long enough: all joints at rest for 2.5 s")
    lost = int(np.sum(~whole))
    note = f"{path}: {lost} of {len(q)} rows have positions or torques that are not numbers and are left out"
    return replace(poses, notes=(note, *poses.notes)) if lost else poses


def _recognised(time: Nanoseconds, q: Float, torque: Float, payload: Float) -> Poses:
    """The poses that an arm held in samples of its motion: times and payloads (N,), angles and torques (N, n)."""
    found, before = held(time, q), turned(q)
    mean = np.array([q[part].mean(axis=0) for part in found]).reshape(-1, q.shape[1])
    known = np.array([torque[part].mean(axis=0) for part in found])
    last = [part.stop - 1 for part in found]
    return Poses(mean, known, mean - before[last], payload[last])


def _grouped(pose: Float, q: Float, torque: Float, came_from: Float, payload: Float) -> Poses:
    """Means of neighbouring rows of one pose.

    Each joint came from where it last turned in the poses before, unless ``came_from`` (N, n) rad is known: a joint
    that did not move on the way to a pose is held from the side of its last movement.
    """
    starts = np.flatnonzero(np.concatenate([[True], np.diff(pose) != 0]))
    count = np.diff(np.append(starts, len(q)))
    means, angles = (np.add.reduceat(each, starts) / count[:, None] for each in (torque, q))
    before = np.where(np.isfinite(came_from[starts]), came_from[starts], turned(angles))
    whole = count >= _SHORT * np.median(count)
    notes = (f"{int(np.sum(~whole))} poses have too few samples and are left out",) if not whole.all() else ()
    return Poses(angles[whole], means[whole], (angles - before)[whole], payload[starts][whole], notes)


def _joined(parts: Sequence[Poses], paths: Sequence[Path]) -> Poses:
    poses = replace(joined(parts), notes=tuple(note for part in parts for note in part.notes))
    where = ", ".join(map(str, paths))
    if (off := unpowered(poses.torque)).any() and not off.all():
        note = f"{int(off.sum())} poses without torque at any joint are left out: the drives were off"
        poses = replace(rows_of(poses, ~off), notes=(*poses.notes, note))
    if len(poses) < FEWEST:
        left_out = "".join(f"; {note}" for note in poses.notes)
        raise RecordingError(
            f"{where}: {len(poses)} poses; a training needs {FEWEST}, and 40 for a good model{left_out}"
        )
    if np.ptp(poses.q, axis=0).max() < _ALIKE or not poses.torque.any():
        raise RecordingError(f"{where}: all poses are the same, or all torques are 0: no model can be trained on them")
    sided = int(np.sum((np.isfinite(poses.approach) & (poses.approach != 0)).any(axis=1)))
    if sided < FEWEST // 2:
        raise RecordingError(
            f"{where}: the side of approach is known in {sided} of {len(poses)} poses, and a training needs it: record "
            "the poses one after the other in one recording, or add columns q_from_1 …"
        )
    return poses
