"""Recordings of cellwatt, or logs of others as if cellwatt had recorded them."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from cellwatt.channel import Channel
from cellwatt.errors import RecordingError
from cellwatt.files import Places, paths_of
from cellwatt.logs.choice import chosen
from cellwatt.logs.log import UNITS, Log
from cellwatt.logs.opening import is_log, read_log
from cellwatt.logs.writing import Part, Samples, write_recording
from cellwatt.record import Recording

SOURCE = "log"
CHANNELS = {"position": "position", "velocity": "velocity", "torque": "torque", "command": "target_position"}
"""What a cell's channels call the quantities of a log."""
FASTEST = 10_000.0
"""Hz of frames."""


def open_recording(source: Places) -> Recording:
    """``Recording.open`` of recordings; logs are written as one, in a folder that goes with the recording.

    Several logs are its parts. Raises ``RecordingError`` and ``ConfigError``.
    """
    paths = paths_of(source)
    logs = [path for path in paths if is_log(path)]
    if not logs:
        return Recording.open(paths)
    if len(logs) < len(paths):
        raise RecordingError(f"{logs[0]} is a log of another program: give it without recordings of cellwatt")
    read = [read_log(path) for path in logs]
    folder = Path(tempfile.mkdtemp(prefix="cellwatt-log-"))
    # A thread of its own: a notebook's has a loop that runs.
    with ThreadPoolExecutor(1) as thread:
        try:
            name = chosen(logs[0])[0].stem
            start = read[0].start
            thread.submit(write_recording, folder, map(_part, read), name, _rate(read), start).result()
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
    recording = Recording.open(folder)
    recording.keeps = kept = _Kept()
    weakref.finalize(kept, shutil.rmtree, folder, ignore_errors=True)
    return recording


class _Kept:
    """Goes with the last copy of a recording."""


def _rate(logs: list[Log]) -> float:
    steps = np.concatenate([np.diff(log.time) for log in logs])
    if not len(steps):
        raise RecordingError(f"{logs[0].path}: a single sample, expected two or more")
    return float(np.clip(round(1 / float(np.median(steps)), 1), 0.1, FASTEST))


def _part(log: Log) -> Part:
    channels = [
        Channel(f"{joint}.{CHANNELS[q]}", UNITS[q], align="hold" if q == "command" else None)
        for q in log.quantities
        for joint in log.joints
    ]
    return Part(str(log.path), {SOURCE: Samples(log.time, tuple(channels), np.hstack([*log.quantities.values()]))})
