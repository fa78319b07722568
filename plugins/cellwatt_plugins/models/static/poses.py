"""Held poses, one row each, from tables and recordings."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float, Nanoseconds, rows_of
from cellwatt.errors import RecordingError
from cellwatt.scheduler import spread
from cellwatt.tables import read_table
from cellwatt_plugins.models.static.held import held, turned
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.samples import torque_in

FEWEST: Final = 12
"""Fewest poses for a training."""
_LIGHT: Final = 0.05  # kg: payloads that differ by less do not show a payload's effect
COLUMNS: Final = ("q", "torque", "approach", "payload")
"""Fields of ``Poses`` with one row per pose."""
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

    A table has a column ``pose`` with one row per sample, in the order in which the poses were visited; or one row per
    pose with a column ``count``; or plain rows ``t``, ``q_i`` and torques, in which poses are recognised, as in
    recordings of cellwatt. Raises ``RecordingError``.
    """
    return _joined(spread(_read, paths, "reading recordings", shared=robot), paths)


def _read(path: Path, robot: RobotDescription) -> Poses:
    table = read_table(path, [joint.name for joint in robot.joints])
    q = table.needed("position", len(robot.joints))
    torque = torque_in(table, robot)
    before = table.joints("came_from")
    approach = np.full_like(q, np.nan) if before is None else q - table.needed("came_from", q.shape[1])
    payload = table.whole("tool.payload")
    payload = _unknown(len(q)) if payload is None else payload
    if "pose" in table.columns:
        if "count" in table.columns:
            return Poses(q, torque, approach, payload)
        return _grouped(table.columns["pose"], q, torque, approach, payload)
    if table.clock is None:
        raise RecordingError(f"{path}: expected a column pose, or t (s) with the arm's motion in between")
    whole = np.isfinite(np.hstack([q, torque])).all(axis=1)
    poses = _recognised(np.rint(table.time[whole] * 1e9).astype(np.int64), q[whole], torque[whole])
    if not len(poses):
        raise RecordingError(f"{path}: no pose was held long enough: all joints at rest for 2.5 s")
    return poses


def _recognised(time: Nanoseconds, q: Float, torque: Float) -> Poses:
    """The poses that an arm held in samples of its motion: times (N,) ns, angles and torques (N, n)."""
    found, before = held(time, q), turned(q)
    mean = np.array([q[part].mean(axis=0) for part in found]).reshape(-1, q.shape[1])
    known = np.array([torque[part].mean(axis=0) for part in found])
    return Poses(mean, known, mean - before[[part.stop - 1 for part in found]], _unknown(len(found)))


def _unknown(count: int) -> Float:
    return np.full(count, np.nan)


def _grouped(pose: Float, q: Float, torque: Float, known: Float, payload: Float) -> Poses:
    """Means of neighbouring rows of one pose; the approach is from the pose before, unless it is known."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(pose) != 0]))
    count = np.diff(np.append(starts, len(q)))
    means, angles = (np.add.reduceat(each, starts) / count[:, None] for each in (torque, q))
    before = np.vstack([np.full((1, q.shape[1]), np.nan), angles[:-1]])
    approach = np.where(np.isfinite(known[starts]), known[starts], angles - before)
    whole = count >= _SHORT * np.median(count)
    notes = (f"{int(np.sum(~whole))} poses have too few samples and are left out",) if not whole.all() else ()
    return Poses(angles[whole], means[whole], approach[whole], payload[starts][whole], notes)


def _joined(parts: Sequence[Poses], paths: Sequence[Path]) -> Poses:
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS}
    whole = Poses(**columns, notes=tuple(note for part in parts for note in part.notes))
    finite = np.isfinite(np.hstack([whole.q, whole.torque])).all(axis=1)
    if not finite.all():
        note = f"{int(np.sum(~finite))} poses have samples that are no numbers and are left out"
        whole = replace(rows_of(whole, np.flatnonzero(finite)), notes=(*whole.notes, note))
    where = ", ".join(map(str, paths))
    if len(whole) < FEWEST:
        left_out = "".join(f"; {note}" for note in whole.notes)
        raise RecordingError(
            f"{where}: {len(whole)} poses; a training needs {FEWEST}, and 40 for a good model{left_out}"
        )
    if np.ptp(whole.q, axis=0).max() < _ALIKE or not whole.torque.any():
        raise RecordingError(f"{where}: all poses are the same, or all torques are 0: a model learns nothing from them")
    return whole
