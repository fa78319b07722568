"""The records of a chunk."""

from __future__ import annotations

from collections.abc import Iterable

from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.record import decoder, messages
from cellwatt.record.chunks import walk
from cellwatt.record.container import message
from cellwatt.record.decoder import Track
from cellwatt.record.rows import FrameRows, SampleRows
from fuzz.items import LAYOUT, MESSAGES, STREAM, batch, frames, same
from fuzz.target import Target

SAMPLES, FRAMES = SampleRows("arm", STREAM), FrameRows(LAYOUT)
KINDS = dict(enumerate(messages.TOPICS, 3))
TRACKS = {
    1: Track("/raw/arm/rtde", SAMPLES, first=0),
    2: Track("/frame", FRAMES, first=5_000_000_000),
    **{number: Track(messages.TOPICS[kind], kind=kind) for number, kind in KINDS.items()},
}


def run(data: bytes) -> None:
    """What a chunk holds when its checksum is right; what was decoded and encoded again decodes to the same."""
    try:
        found = walk(data)
    except ValueError:
        return
    found.index()
    try:
        items = [item for _, item in decoder.numbered(data, TRACKS, set(TRACKS))]
    except ValueError:
        return
    for item in items:
        ((_, again),) = decoder.numbered(encoded(item), TRACKS, set(TRACKS))
        assert same(item, again), (item, again)


def encoded(item: decoder.Item) -> bytes:
    """An item as records."""
    if isinstance(item, Batch):
        return SAMPLES.encode(item, 1).tobytes()
    if isinstance(item, Frames):
        return FRAMES.encode(item, 2).tobytes()
    number = next(number for number, kind in KINDS.items() if isinstance(item, kind))
    return message(number, 0, messages.time_of(item), messages.encode(item))


def seeds() -> Iterable[bytes]:
    """Each kind of item."""
    yield encoded(batch(0, 2)) + encoded(batch(2, 1, device=False)) + encoded(frames(5, 2))
    for item in MESSAGES:
        yield encoded(item)


TARGET = Target(run, seeds, 1024)
