"""Parts as a recording: raw samples of each source, and the frames that the daemon would have made of them."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.align import Aligner
from cellwatt.batch import Batch
from cellwatt.channel import Channel, Quality, Stream
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.record import Header, Recorder, RecordSettings
from cellwatt.turns import counted_on

START = 1_000_000_000_000_000_000
"""UTC ns that the first part begins at where nobody says when it was recorded."""
PAUSE = 5_000_000_000
"""ns between parts: long enough for the frames in between to be missing."""
WAIT = 600.0
"""s that the disk may take for a part."""
BLOCK = 0.1
"""s of samples handed on at a time, as a device would: sources that are slower are awaited."""


@dataclass(frozen=True)
class Samples:
    """Samples of one source in one part: time (N,) s, values (N, channels)."""

    time: NDArray[np.float64]
    channels: tuple[Channel, ...]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """One log: samples by source."""

    name: str
    sources: Mapping[str, Samples]


def write_recording(
    folder: Path, parts: Iterable[Part], cell: str, rate: float, start: int | None = None
) -> dict[str, int]:
    """Writes a recording with frames at ``rate`` Hz; gives how many parts, samples and frames.

    ``start`` is the UTC ns at which the first part begins, where that is known.

    Raises ``RecordingError`` where parts differ in their channels, or the disk does not take them.
    """
    recorder: Recorder | None = None
    streams: dict[str, tuple[Stream, ...]] = {}
    counts = {"parts": 0, "samples": 0, "frames": 0}
    sequence: dict[str, int] = {}
    start = session = START if start is None else start
    try:
        for part in parts:
            if recorder is None:
                streams = {name: (_stream(name, each),) for name, each in part.sources.items()}
                recorder = Recorder(RecordSettings(folder=folder), Header(cell, cell, session, streams=streams))
                aligner = Aligner(streams, rate, max(0.5, 3 / rate))
                recorder.start()
            zero = min(each.time[0] for each in part.sources.values())
            batches = []
            for name, each in part.sources.items():
                if each.channels != streams[name][0].channels:
                    raise RecordingError(f"{part.name}: other columns than in the parts before")
                batches += _batches(name, streams[name][0], _counted_on(each), start, zero, sequence)
            for batch in sorted(batches, key=lambda each: each.arrival):
                _taken(recorder.put(batch), recorder)
                counts["samples"] += len(batch)
                counts["frames"] += _frames_taken(aligner.add(batch), recorder)
            start = max(batch.arrival for batch in batches) + PAUSE
            counts["parts"] += 1
            if not recorder.flush(WAIT):
                raise RecordingError(f"{folder} does not take what is written: {recorder.stats()['problem']}")
        if recorder is None:
            raise RecordingError("the files hold nothing to import")
        counts["frames"] += _frames_taken(aligner.flush(), recorder)
    finally:
        if recorder is not None:
            asyncio.run(recorder.close())
    return counts


def _stream(source: str, samples: Samples) -> Stream:
    rate = 1 / float(np.median(np.diff(samples.time))) if len(samples.time) > 1 else 0.0
    return Stream(source, samples.channels, round(rate, 3), "device")


def _counted_on(samples: Samples) -> Samples:
    """Angles modulo a turn counted on, so that no frame lies between one end of the turn and the other."""
    angles = [i for i, channel in enumerate(samples.channels) if channel.unit == "rad" and "position" in channel.name]
    values = samples.values.copy()
    for i in angles:
        values[:, i] = counted_on(values[:, i])
    return replace(samples, values=values)


def _batches(
    source: str, stream: Stream, samples: Samples, start: int, zero: float, sequence: dict[str, int]
) -> list[Batch]:
    time = start + np.round((samples.time - zero) * 1e9).astype(np.int64)
    edges = np.flatnonzero(np.diff((samples.time - zero) // BLOCK)) + 1
    out = []
    for rows in np.split(np.arange(len(time)), edges):
        values = samples.values[rows]
        quality = np.where(np.isfinite(values).any(axis=1), Quality.GOOD, Quality.MISSING).astype(np.uint8)
        bound = np.zeros(len(rows), np.int64)
        first = sequence.get(source, 0)
        out.append(Batch(source, stream, first, int(time[rows[-1]]), time[rows], bound, values, quality))
        sequence[source] = first + len(rows)
    return out


def _frames_taken(blocks: Iterable[Frames], recorder: Recorder) -> int:
    """Record frames; gives how many."""
    count = 0
    for frames in blocks:
        _taken(recorder.put(frames), recorder)
        count += len(frames)
    return count


def _taken(taken: bool, recorder: Recorder) -> None:
    if not taken and not recorder.flush(WAIT):
        raise RecordingError(f"{recorder.settings.folder}: the disk does not keep up")
    if not taken:
        raise RecordingError(f"{recorder.settings.folder}: a block was refused; import fewer parts at a time")
