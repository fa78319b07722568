"""Samples of an arm and of the analyzer beside it in a recording, in a span of the cell's time."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.channel import Stream
from cellwatt.errors import RecordingError
from cellwatt.record import Recording
from cellwatt_plugins.robot import Arm

Float = NDArray[np.float64]
Nanoseconds = NDArray[np.int64]

POWER = "supply.power"


@dataclass(frozen=True)
class Span:
    """A stretch of the cell's time, UTC ns."""

    start: int
    end: int


@dataclass(frozen=True)
class Rows:
    """Samples of one stream: ``time`` (N,) UTC ns and ``values`` (N, k); samples with a value missing are left out."""

    time: Nanoseconds
    values: Float


class Recorded:
    """The files of a recording, read span by span: a folder may hold weeks.

    ``source`` names the arm's source and ``supply`` the analyzer's, where several have joints or ``supply.power``.
    Raises ``RecordingError`` where the recording has none.
    """

    def __init__(self, folder: Path, arm: Arm, source: str | None = None, supply: str | None = None) -> None:
        self._place = folder
        self._whole = Recording.open(folder)
        self._arm_at = _stream_with(self._whole, "joint_1.position", source, folder)
        self._supply_at = _stream_with(self._whole, POWER, supply, folder)
        self._columns, self._gain = _joint_columns(self._arm_at[1], arm, folder)

    @property
    def span(self) -> Span:
        """All of it."""
        return Span(self._whole.start, self._whole.end)

    def motion(self, span: Span) -> Rows:
        """Positions, velocities and torques, (N, 3 n) rad, rad/s, Nm."""
        rows = self._read(self._arm_at, self._columns, span)
        return Rows(rows.time, rows.values * self._gain)

    def power(self, span: Span) -> Rows:
        """The analyzer's values, (N, 1) W."""
        return self._read(self._supply_at, (POWER,), span)

    def _read(self, at: tuple[str, Stream], names: tuple[str, ...], span: Span) -> Rows:
        source, stream = at
        columns = [stream.names.index(name) for name in names]
        start, end = ((t - self._whole.start) / 1e9 for t in (span.start, span.end))
        samples = self._whole.within(start, end).batches(source, stream.name)
        picked = samples.values[:, columns]
        whole = np.isfinite(picked).all(axis=1)
        if not whole.any():
            raise RecordingError(
                f"{self._place}: nothing of {source} in the recording at that time: was cellwatt running?"
            )
        return Rows(samples.time[whole], picked[whole])


def _stream_with(whole: Recording, channel: str, wanted: str | None, folder: Path) -> tuple[str, Stream]:
    found = [(source, s) for source, streams in whole.streams.items() for s in streams if channel in s.names]
    chosen = [one for one in found if wanted in (None, one[0])]
    if len(chosen) == 1:
        return chosen[0]
    there = ", ".join(source for source, _ in found) or "none"
    option = "--source" if channel != POWER else "--supply"
    raise RecordingError(f"{folder}: expected one source with {channel}, there are: {there}; choose it with {option}")


def _joint_columns(stream: Stream, arm: Arm, folder: Path) -> tuple[tuple[str, ...], Float]:
    """Names of the 3 n columns, and what each is multiplied by: currents become torques by the torque constant."""
    joints = range(1, arm.joints + 1)
    measured = all(f"joint_{i}.torque" in stream.names for i in joints)
    third = "torque" if measured else "current"
    names = tuple(f"joint_{i}.{quantity}" for quantity in ("position", "velocity", third) for i in joints)
    if missing := [name for name in names if name not in stream.names]:
        raise RecordingError(f"{folder}: {stream.name} has no {missing[0]}: add it to the source's channels and repeat")
    gain = np.ones(len(names))
    if not measured:
        gain[2 * arm.joints :] = arm.column("torque_constant")
    return names, gain
