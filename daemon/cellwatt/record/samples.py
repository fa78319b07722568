"""All samples of one stream as arrays, joined from the batches in which they were recorded."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float, Nanoseconds, Qualities
from cellwatt.batch import Batch, Tick
from cellwatt.channel import Stream
from cellwatt.errors import RecordingError

Entry = TypeVar("Entry", bound=Batch | Tick)


@dataclass(frozen=True, slots=True)
class Samples:
    """All samples of one stream: arrays (n,) as in ``Batch``, ``values`` (n, channels).

    ``sequence`` and ``arrival`` (n,) are those of each sample; sequence numbers restart with each session.
    """

    source: str
    stream: Stream
    sequence: NDArray[np.int64]
    arrival: Nanoseconds
    time: Nanoseconds
    bound: Nanoseconds
    values: Float
    quality: Qualities
    device_time: Nanoseconds | None

    def __len__(self) -> int:
        return len(self.time)


def join(source: str, stream: Stream, batches: Sequence[Batch]) -> Samples:
    """Join batches of one stream; device times only if every batch has them."""
    times = [b.device_time for b in batches if b.device_time is not None]
    no_time = np.empty(0, np.int64)
    return Samples(
        source=source,
        stream=stream,
        sequence=np.concatenate([no_time, *(np.arange(b.sequence, b.sequence + len(b)) for b in batches)]),
        arrival=np.concatenate([no_time, *(np.full(len(b), b.arrival) for b in batches)]),
        time=np.concatenate([no_time, *(b.time for b in batches)]),
        bound=np.concatenate([no_time, *(b.bound for b in batches)]),
        values=np.concatenate([np.empty((0, len(stream.channels))), *(b.values for b in batches)]),
        quality=np.concatenate([np.empty(0, np.uint8), *(b.quality for b in batches)]),
        device_time=np.concatenate(times) if times and len(times) == len(batches) else None,
    )


def unchanged(entries: Iterable[Entry], streams: Mapping[str, Iterable[Stream]], advice: str) -> Iterator[Entry]:
    """Yield ``entries`` whose channels have the names and units declared in ``streams``, by source.

    Raises ``RecordingError`` with ``advice`` at the first batch with other channels.
    """
    declared = {(source, stream.name): stream for source, its in streams.items() for stream in its}
    for entry in entries:
        if isinstance(entry, Batch):
            key = entry.source, entry.stream.name
            if entry.stream is not declared[key]:  # usually the same object as in the batch before
                if _columns(entry.stream) != _columns(declared[key]):
                    raise RecordingError(f"the channels of {'/'.join(key)} change within these recordings: {advice}")
                declared[key] = entry.stream
        yield entry


def _columns(stream: Stream) -> list[tuple[str, str]]:
    return [(channel.name, channel.unit) for channel in stream.channels]
