"""Samples of an emulated controller and their times: its own cycles, or the rows of a recording."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.emulation import RecordedSignals, Signals
from cellwatt_drivers.ur.fields import FIELDS, Field
from cellwatt_drivers.ur.wire import ELEMENTS, Kind

Numbers = NDArray[np.int64]

PUNCTUAL = 1e-3
"""Share of a cycle by which a timer may fire early because of rounding."""
BOOTED = 60.0
"""Controller time, s, at the start of an emulation without a recording."""

STAND_INS: Mapping[str, str] = {
    "target_q": "actual_q",
    "target_qd": "actual_qd",
    "target_current": "actual_current",
    "joint_control_output": "actual_current",
    "target_moment": "actual_current_as_torque",
}
"""Fields that use another field's values if the signals lack them."""

CONSTANTS: Mapping[str, float | Sequence[float]] = {
    "robot_mode": 7,
    "joint_mode": 253,
    "safety_mode": 1,
    "safety_status": 1,
    "runtime_state": 2,
    "robot_status_bits": 3,
    "safety_status_bits": 1,
    "speed_scaling": 1.0,
    "target_speed_fraction": 1.0,
    "actual_main_voltage": 48.0,
    "actual_robot_voltage": 48.0,
    "actual_robot_current": 0.7,
    "actual_joint_voltage": 48.0,
    "joint_temperatures": 30.0,
    "tool_temperature": 30.0,
    "tool_output_voltage": 0,
    "actual_TCP_pose": (-0.3, -0.2, 0.4, 0.0, 3.14, 0.0),
    "target_TCP_pose": (-0.3, -0.2, 0.4, 0.0, 3.14, 0.0),
    "actual_tool_accelerometer": (0.0, 0.0, -9.81),
    "actual_execution_time": 0.2,
    "payload": 1.0,
}
"""Values of other fields that the signals lack; a field not listed here is 0."""


class Cycles:
    """A controller at ``rate`` Hz in a world whose time is ``offset`` s at the start.

    Samples are numbered 0, 1, 2 …; times are s since the start of the emulation. ``end`` is the number of samples if
    they end; ``rate`` is ``None`` if every client gets all samples, whatever rate it requests.
    """

    def __init__(self, signals: Signals, rate: float, offset: float) -> None:
        self.end: int | None = None
        self.rate: float | None = rate
        self._signals = signals
        self._offset = offset
        self._hertz = rate

    def due(self, elapsed: float) -> int:
        """Return how many samples have been made after ``elapsed`` s."""
        return int(elapsed * self._hertz + PUNCTUAL) + 1

    def stamps(self, numbers: Numbers) -> Float:
        """Return the controller time (n,) s of samples."""
        return np.asarray(BOOTED + numbers / self._hertz)

    def columns(self, numbers: Numbers) -> Mapping[str, Float]:
        """Return values (n,) of samples by channel or RTDE column."""
        return self._signals.at(self._offset + numbers / self._hertz)


class Rows:
    """The rows of a recording at their recorded times with their recorded timestamps.

    In a loop, each lap's timestamps are later by the recording's length and one median step; with ``hold`` the last row
    is repeated for ever at the median step.
    """

    def __init__(self, recording: RecordedSignals, hold: bool) -> None:
        self.rate: float | None = None
        self._time = recording.time
        self._table = recording.columns
        self._rows = len(recording.time)
        self._offsets = recording.time - recording.time[0]
        self._step = float(np.median(np.diff(recording.time)))
        self._lap = recording.length + self._step
        self._loop = recording.loop
        self.end: int | None = None if recording.loop or hold else self._rows

    def due(self, elapsed: float) -> int:
        """See ``Cycles``."""
        if self._loop:
            lap = int(elapsed / self._lap)
            return lap * self._rows + int(self._offsets.searchsorted(elapsed - lap * self._lap, side="right"))
        if elapsed > self._offsets[-1]:
            beyond = 0 if self.end is not None else int((elapsed - self._offsets[-1]) / self._step)
            return self._rows + beyond
        return int(self._offsets.searchsorted(elapsed, side="right"))

    def next(self, elapsed: float) -> float:
        """Return when the next row falls due after ``elapsed`` s, s since the start; inf: no further row."""
        due = self.due(elapsed)
        return math.inf if due == self.end else float(self.stamps(np.array([due]))[0] - self._time[0])

    def stamps(self, numbers: Numbers) -> Float:
        """See ``Cycles``."""
        lap, row, more = self._locate(numbers)
        return np.asarray(self._time[row] + (lap * self._lap + more * self._step))

    def columns(self, numbers: Numbers) -> Mapping[str, Float]:
        """See ``Cycles``."""
        _, row, _ = self._locate(numbers)
        return {name: values[row] for name, values in self._table.items()}

    def _locate(self, numbers: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Lap, row, and number of steps beyond the last row."""
        if self._loop:
            return numbers // self._rows, numbers % self._rows, np.zeros_like(numbers)
        return np.zeros_like(numbers), np.minimum(numbers, self._rows - 1), np.maximum(numbers - self._rows + 1, 0)


Samples = Cycles | Rows


class Encoder:
    """Encodes data packages of one recipe from columns, many at once."""

    def __init__(self, recipe: int, names: Sequence[str]) -> None:
        self._names = names
        types = [FIELDS[n].type for n in names]
        body = [(f"f{i}", *_shape(t)) for i, t in enumerate(types)]
        self._dtype = np.dtype([("size", ">u2"), ("kind", "u1"), ("recipe", "u1"), *body])
        self._recipe = recipe
        self.size = self._dtype.itemsize

    def encode(self, stamps: Float, columns: Mapping[str, Float]) -> bytes:
        """Encode packages (n,), one after the other, for controller times (n,) s."""
        packages = np.zeros(len(stamps), self._dtype)
        packages["size"] = self.size
        packages["kind"] = Kind.DATA_PACKAGE
        packages["recipe"] = self._recipe
        for i, name in enumerate(self._names):
            packages[f"f{i}"] = stamps if name == "timestamp" else _values(FIELDS[name], columns, len(stamps))
        return packages.tobytes()


def _shape(name: str) -> tuple[str, tuple[int, ...]]:
    code, width = ELEMENTS[name]
    return code, () if width == 1 else (width,)


def _values(field: Field, columns: Mapping[str, Float], n: int) -> Float:
    """Values (n,) or (n, width) of a field in RTDE's units."""
    found = _served(field, columns)
    if found is None and field.name in STAND_INS:
        found = _served(FIELDS[STAND_INS[field.name]], columns)
    constant = np.broadcast_to(np.asarray(CONSTANTS.get(field.name, 0.0), dtype=np.float64), (n, field.width))
    table = constant if found is None else found
    if not ELEMENTS[field.type][0].endswith("f8"):
        # Integers have no NaN: a NaN of a recording becomes the usual value.
        table = np.where(np.isfinite(table), table, constant)
    return table[:, 0] if field.width == 1 else table


def _served(field: Field, columns: Mapping[str, Float]) -> Float | None:
    """Values (n, width) from columns named as RTDE records or as channels; ``None`` if a column is lacking."""
    raw = [field.name] if field.width == 1 else [f"{field.name}_{i}" for i in range(field.width)]
    if all(name in columns for name in raw):
        return np.column_stack([columns[name] for name in raw])
    names = [c.name for c in field.channels]
    if names and all(name in columns for name in names):
        return np.column_stack([columns[name] for name in names]) / field.scale
    return None
