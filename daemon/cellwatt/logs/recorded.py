"""Opens recordings of cellwatt, and logs of other programs as if cellwatt had recorded them."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cellwatt.align import Aligner
from cellwatt.batch import Batch
from cellwatt.channel import Channel, Quality, Stream
from cellwatt.errors import RecordingError
from cellwatt.files import Places, paths_of
from cellwatt.logs.choice import chosen
from cellwatt.logs.log import UNITS, Log
from cellwatt.logs.opening import is_log, read_log
from cellwatt.record import Header, Recording
from cellwatt.record.cut import write_file
from cellwatt.record.encoder import Item
from cellwatt.record.header import FileName
from cellwatt.tables.unwrap import unwrapped

SOURCE = "log"
CHANNELS = {"position": "position", "velocity": "velocity", "torque": "torque", "command": "target_position"}
"""Names of a log's quantities in the channels of a cell."""
FASTEST = 10_000.0
"""Largest rate of frames, Hz."""
START = 1_000_000_000_000_000_000
"""Start of the first log, UTC ns, if the log has none."""
PAUSE = 5_000_000_000
"""Pause between logs, ns: long enough for the frames in between to be missing."""
BLOCK = 0.1
"""Length of a block of samples, s."""


def open_recording(source: Places) -> Recording:
    """Open recordings; logs are converted to one recording in a temporary folder, deleted with the recording.

    Several logs follow one another in it. Raises ``RecordingError`` and ``ConfigError``.
    """
    paths = paths_of(source)
    logs = [path for path in paths if is_log(path)]
    if not logs:
        return Recording.open(paths)
    if len(logs) < len(paths):
        raise RecordingError(f"{logs[0]} is a log of another program: give it without recordings of cellwatt")
    read = [read_log(path) for path in logs]
    folder = Path(tempfile.mkdtemp(prefix="cellwatt-log-"))
    try:
        _write(folder, chosen(logs[0])[0].stem, read)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    recording = Recording.open(folder)
    recording.keeps = kept = _TemporaryCopy()
    weakref.finalize(kept, shutil.rmtree, folder, ignore_errors=True)
    return recording


class _TemporaryCopy:
    """Owner of the temporary folder, which is deleted with the last copy of the recording."""


def _write(folder: Path, cell: str, logs: Sequence[Log]) -> None:
    """Write a recording, with the frames that the daemon would have made."""
    session = START if logs[0].start is None else logs[0].start
    header = Header(cell, cell, session, streams={SOURCE: (_stream(logs[0]),)}, number=1)
    write_file(folder / str(FileName(session, 1, cell)), header, ((header, item) for item in _items(logs, header)))


def _items(logs: Sequence[Log], header: Header) -> Iterator[Item]:
    (stream,) = header.streams[SOURCE]
    rate = _rate(logs)
    aligner = Aligner(header.streams, rate, max(0.5, 3 / rate))
    start, sequence = header.session, 0
    for log in logs:
        if _channels(log) != stream.channels:
            raise RecordingError(f"{log.path}: other columns than in the parts before")
        for batch in _batches(log, stream, start, sequence):
            yield batch
            yield from aligner.add(batch)
        start, sequence = batch.arrival + PAUSE, batch.sequence + len(batch)
    yield from aligner.flush()


def _batches(log: Log, stream: Stream, start: int, sequence: int) -> Iterator[Batch]:
    values = np.hstack([*log.quantities.values()])
    for i, channel in enumerate(stream.channels):
        if channel.unit == "rad" and "position" in channel.name:  # no frame interpolates across a turn
            values[:, i] = unwrapped(values[:, i])
    since = log.time - log.time[0]
    time = start + np.round(since * 1e9).astype(np.int64)
    for rows in np.split(np.arange(len(time)), np.flatnonzero(np.diff(since // BLOCK)) + 1):
        heard = np.isfinite(values[rows]).any(axis=1)
        quality = np.where(heard, Quality.GOOD, Quality.MISSING).astype(np.uint8)
        bound = np.zeros(len(rows), np.int64)
        first = sequence + int(rows[0])
        yield Batch(SOURCE, stream, first, int(time[rows[-1]]), time[rows], bound, values[rows], quality)


def _stream(log: Log) -> Stream:
    rate = 1 / float(np.median(np.diff(log.time))) if len(log.time) > 1 else 0.0
    return Stream(SOURCE, _channels(log), round(rate, 3), "device")


def _rate(logs: Sequence[Log]) -> float:
    """Rate of the frames, Hz."""
    steps = np.concatenate([np.diff(log.time) for log in logs])
    if not len(steps):
        raise RecordingError(f"{logs[0].path}: a single sample, expected two or more")
    return float(np.clip(round(1 / float(np.median(steps)), 1), 0.1, FASTEST))


def _channels(log: Log) -> tuple[Channel, ...]:
    return tuple(
        Channel(f"{joint}.{CHANNELS[q]}", UNITS[q], align="hold" if q == "command" else None)
        for q in log.quantities
        for joint in log.joints
    )
