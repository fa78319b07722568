"""Frames from what a person brings: cellwatt recordings, or tables with columns t, q_1 … q_n and power."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.channel import Quality
from cellwatt.emulation.signals import load_signals
from cellwatt.errors import RecordingError
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.record.reader import Recording
from cellwatt_plugins.robot.meter import onto, power_beside, with_meters

Float = NDArray[np.float64]

SOURCE = "table"
"""Source name of a table's channels."""
APART = 10 * 10**9
"""Time between one table and the next, ns: nothing goes on from one to the other."""
BLOCK = 4096
"""Frames in a block."""
_POSITION = re.compile(r"q_([1-9]\d*)$")


def frames_of_files(paths: Sequence[Path], meters: Sequence[Path] = ()) -> Iterator[Frames]:
    """Blocks of frames of several files in the order given; ``meters`` logged the power of tables in the same place.

    Raises ``RecordingError``.
    """
    tables = [p for p in paths if p.suffix in {".parquet", ".csv"}]
    paired = with_meters(tables, meters)
    if not tables:
        yield from Recording.open(paths).frames()
        return
    if len(tables) < len(paths):
        raise RecordingError("recordings and tables cannot be mixed: give only .mcap files, or only .parquet and .csv")
    start = 0
    for path, meter in paired:
        signals = load_signals(path)
        columns = dict(signals.columns)
        if meter is not None:
            positions = [values for name, values in columns.items() if _POSITION.match(name)]
            columns["power"] = power_beside(meter, signals.time, np.column_stack(positions))
        frames = frames_of_table(signals.time, columns, start, str(path))
        start = int(frames.time[-1]) + APART
        for i in range(0, len(frames), BLOCK):
            yield _part(frames, i, i + BLOCK)


def frames_of_table(time: Float, columns: Mapping[str, Float], start: int = 0, name: str = "table") -> Frames:
    """A table on the grid of its median rate: ``time`` (n,) s rising, columns q_1 … q_n rad and power W, (n,) each.

    Values are interpolated; where rows are more than two steps apart they are missing. ``start`` ns is the
    earliest grid point. Raises ``RecordingError`` (with ``name``) where a column is missing.
    """
    joints = sorted(int(m[1]) for column in columns if (m := _POSITION.match(column)))
    if not joints or joints != list(range(1, len(joints) + 1)) or "power" not in columns:
        there = ", ".join(list(columns)[:8]) + (" …" if len(columns) > 8 else "")
        raise RecordingError(f"{name}: expected columns t, q_1 … q_n and power; there are: {there}")
    steps = np.diff(time)
    rate = float(round(1 / np.median(steps), 1))
    grid = time[0] + np.arange(int((time[-1] - time[0]) * rate + 1e-6) + 1) / rate
    names = [*(f"q_{joint}" for joint in joints), "power"]
    values = np.column_stack([(onto if n == "power" else np.interp)(grid, time, columns[n]) for n in names])
    row = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(steps) - 1)
    values[(steps[row] > 2.5 / rate) & (grid > time[row])] = np.nan
    layout = Layout(_channels(joints), rate)
    first = -(-max(start, round(time[0] * 1e9)) // layout.step)
    return Frames(
        layout=layout,
        sequence=0,
        time=(first + np.arange(len(grid))) * layout.step,
        values=values,
        quality=np.where(np.isnan(values), Quality.MISSING, Quality.INTERPOLATED).astype(np.uint8),
        bound=np.zeros(values.shape, np.int64),
    )


def _channels(joints: Sequence[int]) -> tuple[FrameChannel, ...]:
    positions = [FrameChannel(f"{SOURCE}.joint_{joint}.position", "rad", "continuous", "linear") for joint in joints]
    return (*positions, FrameChannel(f"{SOURCE}.supply.power", "W", "continuous", "average"))


def _part(frames: Frames, first: int, last: int) -> Frames:
    part = slice(first, last)
    return Frames(
        frames.layout,
        frames.sequence + first,
        frames.time[part],
        frames.values[part],
        frames.quality[part],
        frames.bound[part],
    )
