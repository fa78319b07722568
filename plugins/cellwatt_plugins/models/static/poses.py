"""Held poses, one row each, from the tables and recordings that a person has."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.static.held import HeldPose, Recogniser
from cellwatt_plugins.models.tables import channel_of, read_table
from cellwatt_plugins.robot import RobotDescription

Float = NDArray[np.float64]

FEWEST: Final = 12
"""Poses that a training needs."""
_LIGHT: Final = 0.05  # kg: payloads that differ by less teach nothing
_SHORT: Final = 0.25
"""Poses with less than this share of the usual number of samples are left out."""


@dataclass(frozen=True)
class Poses:
    """N held poses of an arm with n joints."""

    q: Float
    """(N, n) rad."""
    torque: Float
    """(N, n) Nm at the joint, mean over the pose."""
    spread: Float
    """(N, n) Nm, standard deviation of the single samples; NaN where there is one."""
    count: NDArray[np.int64]
    """(N,) samples."""
    approach: Float
    """(N, n) rad, the way each joint came to the pose; NaN where that is not known."""
    payload: Float
    """(N,) kg at the tool beside what the arm always carries; NaN where not known."""
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.q)

    def rows(self, which: NDArray[np.intp]) -> Poses:
        """Some of the poses."""
        return Poses(
            self.q[which],
            self.torque[which],
            self.spread[which],
            self.count[which],
            self.approach[which],
            self.payload[which],
            self.notes,
        )

    @property
    def payload_known(self) -> bool:
        """Whether poses with different payloads say what a payload does."""
        known = self.payload[np.isfinite(self.payload)]
        return bool(len(known) and np.ptp(known) > _LIGHT)

    @property
    def total(self) -> Float:
        """Absolute sum of the torques (N,) Nm; eq. 5 of the paper."""
        return np.asarray(np.sum(np.abs(self.torque), axis=1))

    @property
    def digest(self) -> str:
        """SHA-256 of what a model may learn from."""
        parts = (self.q, self.torque, self.approach, self.payload[:, None])
        return hashlib.sha256(np.hstack(parts).astype("<f8").tobytes()).hexdigest()


def read_poses(paths: Sequence[Path], robot: RobotDescription) -> Poses:
    """The poses of all files in the order given.

    A table has a column ``pose`` and as many rows of each as were sampled, in the order in which they were visited; or
    one row a pose with a column ``count``; or plain rows ``t``, ``q_i`` and torques in which the poses are recognised.
    Recordings of cellwatt are read like the last. Raises ``RecordingError``.
    """
    return _joined([_read(path, robot) for path in paths], paths)


def _read(path: Path, robot: RobotDescription) -> Poses:
    table = read_table(path)
    columns = {name: _numbers(table[name]) for name in table.column_names if _is_number(table[name].type)}
    q = _joints(columns, "position", robot, path)
    torque, unit = _torque(columns, robot, path)
    if "count" in columns and "pose" in columns:
        return _collected(columns, q, torque, unit)
    if "pose" in columns:
        return _grouped(columns, q, torque)
    if "t" not in columns:
        raise RecordingError(f"{path}: expected a column pose, or t (s) with the arm's motion in between")
    found = list(_recognised(columns["t"], q, torque))
    if not found:
        raise RecordingError(f"{path}: no pose was held long enough: all joints at rest for 2.5 s")
    return of_held(found)


def of_held(found: Sequence[HeldPose]) -> Poses:
    """Recognised poses."""
    return Poses(
        np.stack([pose.q for pose in found]),
        np.stack([pose.torque for pose in found]),
        np.stack([pose.spread for pose in found]),
        np.array([pose.count for pose in found]),
        np.stack([pose.approach for pose in found]),
        np.full(len(found), np.nan),
    )


def _recognised(t: Float, q: Float, torque: Float) -> list[HeldPose]:
    recogniser = Recogniser(q.shape[1])
    return recogniser.update(np.rint(t * 1e9).astype(np.int64), q, torque)


def _collected(columns: Mapping[str, Float], q: Float, torque: Float, unit: Float) -> Poses:
    unknown = np.full(len(q), np.nan)
    spread = [columns.get(f"torque_spread_{i + 1}", unknown) for i in range(q.shape[1])]
    return Poses(
        q,
        torque,
        unit * np.column_stack(spread),
        columns["count"].astype(np.int64),
        _known_approach(columns, q, np.arange(len(q))),
        columns.get("payload", unknown),
    )


def _grouped(columns: Mapping[str, Float], q: Float, torque: Float) -> Poses:
    """Means of neighbouring rows of one pose; each is come to from the one before it."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(columns["pose"]) != 0]))
    count = np.diff(np.append(starts, len(q)))
    means, spreads = _mean(torque, starts, count)
    angles, _ = _mean(q, starts, count)
    before = np.vstack([np.full((1, q.shape[1]), np.nan), angles[:-1]])
    known = _known_approach(columns, q, starts)
    payload = columns.get("payload", np.full(len(q), np.nan))[starts]
    approach = np.where(np.isfinite(known), known, angles - before)
    whole = count >= _SHORT * np.median(count)
    notes = (f"{int(np.sum(~whole))} poses have too few samples and are left out",) if not whole.all() else ()
    return Poses(angles[whole], means[whole], spreads[whole], count[whole], approach[whole], payload[whole], notes)


def _known_approach(columns: Mapping[str, Float], q: Float, rows: NDArray[np.intp]) -> Float:
    unknown = np.full(len(q), np.nan)
    return np.column_stack([(q[:, i] - columns.get(f"q_from_{i + 1}", unknown))[rows] for i in range(q.shape[1])])


def _mean(values: Float, starts: NDArray[np.intp], count: NDArray[np.intp]) -> tuple[Float, Float]:
    """Mean and standard deviation of neighbouring rows."""
    each = count[:, None]
    mean = np.add.reduceat(values, starts) / each
    square = np.add.reduceat((values - np.repeat(mean, count, axis=0)) ** 2, starts)
    return mean, np.sqrt(np.where(each > 1, square / np.maximum(each - 1, 1), np.nan))


def _joints(columns: Mapping[str, Float], quantity: str, robot: RobotDescription, path: Path) -> Float:
    found = [channel_of(f"joint_{i + 1}.{quantity}", columns, path) for i in range(len(robot.joints))]
    if any(column is None for column in found):
        missing = next(i for i, column in enumerate(found) if column is None)
        there = ", ".join(list(columns)[:12])
        raise RecordingError(f"{path}: no {quantity} of joint {missing + 1}; there are: {there}")
    return np.column_stack([column for column in found if column is not None])


def _torque(columns: Mapping[str, Float], robot: RobotDescription, path: Path) -> tuple[Float, Float]:
    """Torques (N, n) Nm from Nm, or from shares of the rated torques; and what one of their unit is, (n,) Nm."""
    joints = range(1, len(robot.joints) + 1)
    for pattern, share in (
        (r"torque_percent_{}", 0.01),
        (r"torque_ratio_{}", 1.0),
        (r"(.+\.)?joint_{}\.torque_ratio", 1.0),
    ):
        names = [next((c for c in columns if re.fullmatch(pattern.format(i), c)), None) for i in joints]
        if all(name is not None for name in names):
            rated = np.array([joint.rated_torque for joint in robot.joints])
            if not rated.all():
                without = robot.joints[int(np.argmin(rated))].name
                raise RecordingError(
                    f"{path}: {names[0]} is a share of the rated torque: write rated_torque (Nm at the joint for "
                    f"100 %) of {without} into robot.yaml"
                )
            unit = share * rated
            return unit * np.column_stack([columns[name] for name in names if name is not None]), unit
    return _joints(columns, "torque", robot, path), np.ones(len(robot.joints))


def _joined(parts: Sequence[Poses], paths: Sequence[Path]) -> Poses:
    whole = Poses(
        np.concatenate([part.q for part in parts]),
        np.concatenate([part.torque for part in parts]),
        np.concatenate([part.spread for part in parts]),
        np.concatenate([part.count for part in parts]),
        np.concatenate([part.approach for part in parts]),
        np.concatenate([part.payload for part in parts]),
        tuple(note for part in parts for note in part.notes),
    )
    finite = np.isfinite(np.hstack([whole.q, whole.torque]))
    whole = whole.rows(np.flatnonzero(finite.all(axis=1)))
    if len(whole) < FEWEST:
        where = ", ".join(map(str, paths))
        raise RecordingError(f"{where}: {len(whole)} poses; a training needs {FEWEST}, and 40 for a good model")
    return whole


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def _numbers(column: pa.ChunkedArray) -> Float:
    return np.asarray(column.cast(pa.float64()).to_numpy(), np.float64)
