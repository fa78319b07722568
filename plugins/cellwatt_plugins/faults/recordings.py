"""Frames from cellwatt recordings, or from tables with time, positions and power."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.channel import Quality
from cellwatt.errors import RecordingError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.logs.opening import is_log
from cellwatt.record.reader import Recording
from cellwatt.scheduler import spread
from cellwatt.tables import read_table
from cellwatt_plugins.robot.meter.file import power_beside, with_meters
from cellwatt_plugins.robot.meter.held import onto
from cellwatt_plugins.robot.samples import most_points

SOURCE = "table"
"""Source name of a table's channels."""
APART = 10 * 10**9
"""Time between the end of one table and the start of the next, ns: no interval continues from one to the other."""
LONGEST = 10.0
"""Longest hole in a table that is filled with frames of missing values, s; a longer hole has no frames."""
SLOWEST = 1.0
"""Longest median time between rows, s: a move of an arm takes little more."""
SAME_RATE = 0.02
"""Largest relative difference of the rates of tables that are read at the rate of the first: time stamps jitter."""


def frames_of_files(
    paths: Sequence[Path], meters: Sequence[Path] = (), joints: Sequence[str] = (), slides: Collection[int] = ()
) -> Iterator[Frames]:
    """Frames of several files in the order given; ``meters[i]`` holds the power that belongs to table ``paths[i]``.

    ``joints`` are the robot's joint names in order, for tables and logs that name their joints; ``slides`` are
    its linear axes (0-based), which else only the units of a table's columns show. Raises ``RecordingError``.
    """
    recordings = [path for path in paths if (path.is_dir() or ".mcap" in path.suffixes) and not is_log(path)]
    if len(recordings) == len(paths):
        if meters:
            raise RecordingError(f"{meters[0]}: a meter's table goes with a table: a recording holds its own power")
        yield from Recording.open(paths).frames()
        return
    if recordings:
        raise RecordingError("recordings and tables cannot be mixed: give only .mcap files, or only .parquet and .csv")
    start, rate = 0, None
    columns = spread(_columns, with_meters(paths, meters), "reading tables", shared=tuple(joints))
    for path, (along, time, position, power) in zip(paths, columns, strict=True):
        frames = _from(frames_of_table(time, position, power, str(path), rate, slides or along), start)
        start, rate = int(frames.time[-1]) + APART, rate or frames.layout.rate
        yield frames


def _columns(files: tuple[Path, Path | None], joints: Sequence[str]) -> tuple[list[int], Float, Float, Float]:
    """Joints (0-based) in units of a linear axis, time, positions and power of a table; power is that of its meter's
    table if one is given."""
    path, meter = files
    table = read_table(path, joints)
    time = table.rising_time()
    if (step := float(np.median(np.diff(time)))) > 1.5 * SLOWEST:
        raise RecordingError(
            f"{path}: rows are {step:g} s apart, expected {SLOWEST:g} s or less: is column {table.clock} in seconds?"
        )
    position, power = table.joints("position"), table.whole("supply.power")
    if position is None:
        raise table.lacks("q_1")
    if meter is not None:
        power = power_beside(meter, time, position)
    if power is None:
        raise table.lacks("power")
    return [j for j, name in enumerate(table.joint_names("position")) if table.along(name)], time, position, power


def _from(frames: Frames, start: int) -> Frames:
    """The frames, shifted by whole steps to begin at ``start`` ns or later."""
    step = frames.layout.step
    return replace(frames, time=frames.time + max(0, -(-start // step) * step - int(frames.time[0])))


def frames_of_table(
    time: Float,
    position: Float,
    power: Float,
    name: str = SOURCE,
    usual: float | None = None,
    slides: Collection[int] = (),
) -> Frames:
    """Resample a table: ``time`` (N,) s rising, ``position`` (N, n) rad, or m of ``slides``, ``power`` (N,) W.

    The rate is the table's median rate, or ``usual`` Hz if that is nearly the same. Values are interpolated, and
    missing where rows are more than 2.5 steps apart. Raises ``RecordingError`` with the ``name`` of the table where
    most of the frames would be missing.
    """
    steps = np.diff(time)
    rate = float(round(1 / np.median(steps), 1))
    rate = usual if usual is not None and abs(rate / usual - 1) < SAME_RATE else rate
    if np.minimum(steps, LONGEST).sum() * rate > most_points(len(time)):
        i = int(np.argmax(np.where(steps > LONGEST, 0.0, steps)))
        raise RecordingError(
            f"{name}: most rows are {1 / rate:g} s apart, row {i + 2} is {steps[i]:g} s after row {i + 1}: are times "
            "rounded, or was the clock set? Give a table with evenly spaced times"
        )
    number = _numbers(time, rate)
    grid = time[0] + number / rate
    values = np.column_stack([*(np.interp(grid, time, column) for column in position.T), onto(grid, time, power)])
    row = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(steps) - 1)
    values[(steps[row] > 2.5 / rate) & (grid > time[row])] = np.nan
    layout = Layout(_channels(position.shape[1], slides), rate)
    first = -(-round(time[0] * 1e9) // layout.step)
    return Frames(
        layout=layout,
        sequence=0,
        time=(first + number) * layout.step,
        values=values,
        quality=np.where(np.isnan(values), Quality.MISSING, Quality.INTERPOLATED).astype(np.uint8),
        bound=np.zeros(values.shape, np.int64),
    )


def _numbers(time: Float, rate: float) -> NDArray[np.int64]:
    """Numbers of the grid points from the first to the last of ``time`` (N,) s, without those in long holes."""
    ends = np.flatnonzero(np.diff(time) > LONGEST)
    since = (time - time[0]) * rate
    first, last = np.ceil(since[[0, *ends + 1]] - 1e-6), np.floor(since[[*ends, -1]] + 1e-6)
    return np.concatenate([np.arange(a, b + 1, dtype=np.int64) for a, b in zip(first, last, strict=True)])


def _channels(joints: int, slides: Collection[int]) -> tuple[FrameChannel, ...]:
    positions = [
        FrameChannel(f"{SOURCE}.joint_{j + 1}.position", "m" if j in slides else "rad", "continuous", "linear")
        for j in range(joints)
    ]
    return (*positions, FrameChannel(f"{SOURCE}.supply.power", "W", "continuous", "average"))
