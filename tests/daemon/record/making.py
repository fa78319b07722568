"""Streams, batches and files for the tests of recordings."""

from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt import Batch, Channel, FrameChannel, Frames, Layout, Stream, Tick
from cellwatt.record import Header, Recorder, RecordSettings
from cellwatt.record.chunks import chunk_data
from cellwatt.record.decoder import numbered, tracks_of
from cellwatt.record.encoder import Encoder, Item
from cellwatt.record.header import FileName
from cellwatt.record.openfile import OpenFile
from cellwatt.record.survey import survey

SESSION = 1_795_255_163_290_084_047
CELL = "weld-3"
HEADER = Header("plant-1", CELL, SESSION, robot="ur10e", settings="site: plant-1\n")
PERIOD = 2_000_000  # ns


def stream_of(channels: int, name: str = "rtde") -> Stream:
    return Stream(name, tuple(Channel(f"joint_{i + 1}.position", "rad") for i in range(channels)), 500.0, "device")


ARM, METER = stream_of(6), stream_of(2, "meter")


def batch_of(
    first: int, n: int, *, stream: Stream = ARM, source: str = "arm", device: bool = True, seed: int = 0
) -> Batch:
    """n samples whose values depend on their sequence number alone."""
    sequence = np.arange(first, first + n)
    values = np.stack([np.random.default_rng([seed, s]).standard_normal(len(stream.channels)) for s in sequence])
    time = SESSION + sequence * PERIOD
    return Batch(
        source=source,
        stream=stream,
        sequence=first,
        arrival=int(time[-1]) + 350_000,
        time=time,
        bound=1000 + sequence,
        values=values,
        quality=(sequence % 5).astype(np.uint8),
        device_time=sequence * PERIOD + 17 if device else None,
    )


def frames_of(first: int, n: int, channels: int = 3) -> Frames:
    columns = tuple(FrameChannel(f"arm.joint_{i + 1}.position", "rad", "continuous", "linear") for i in range(channels))
    random = np.random.default_rng(first)
    return Frames(
        layout=Layout(columns, 50.0),
        sequence=first,
        time=SESSION + np.arange(first, first + n) * 20_000_000,
        values=random.standard_normal((n, channels)),
        quality=random.integers(0, 5, (n, channels)).astype(np.uint8),
        bound=random.integers(0, 1 << 40, (n, channels)),
    )


def name_of(number: int = 1) -> str:
    return str(FileName(SESSION, number, CELL))


def write_chunks(
    folder: Path,
    chunks: Iterable[Iterable[Item]],
    *,
    number: int = 1,
    close: bool = True,
    header: Header = HEADER,
) -> OpenFile:
    """A file whose chunks hold exactly these items; with ``close=False`` as a killed writer leaves it."""
    name = FileName(header.session, number, header.cell)
    file = OpenFile(folder / str(name), replace(header, number=number))
    encoder = Encoder(file)
    for chunk in chunks:
        for item in chunk:
            encoder.add(item)
        file.write_chunk()
    if close:
        file.finish()
        file.publish()
    else:
        file.release()
    return file


def weld(settings: str, **streams: tuple[Stream, ...]) -> Header:
    """The header of a cell whose streams are those of an arm, and others."""
    return Header("plant", "weld", SESSION, None, settings, {"arm": (ARM,), **streams})


def numbered_in(folder: Path) -> dict[str, list[tuple[int, Item]]]:
    """Results and events with their numbers in the order of the record, by series."""
    found: dict[str, list[tuple[int, Item]]] = {}
    for path in sorted(folder.glob("*.mcap")):
        contents = survey(path).contents
        tracks = tracks_of(contents.channels)[0]
        with path.open("rb") as file:
            for channel, track in tracks.items():
                if track.series is not None and track.rows is None:
                    for chunk in contents.chunks.holding(channel):
                        found.setdefault(track.series, []).extend(numbered(chunk_data(file, chunk), tracks, {channel}))
    return found


def bits(values: np.ndarray) -> bytes:
    return np.ascontiguousarray(values).tobytes()


def same_batch(a: Batch, b: Batch) -> bool:
    """Equal to the last bit."""
    return (
        (a.source, a.stream, a.sequence, a.arrival) == (b.source, b.stream, b.sequence, b.arrival)
        and all(bits(getattr(a, name)) == bits(getattr(b, name)) for name in ("time", "bound", "values", "quality"))
        and (a.device_time is None) == (b.device_time is None)
        and (a.device_time is None or b.device_time is None or bits(a.device_time) == bits(b.device_time))
    )


def same_entry(a: Batch | Tick, b: Batch | Tick) -> bool:
    return same_batch(a, b) if isinstance(a, Batch) and isinstance(b, Batch) else a == b


@asynccontextmanager
async def started(settings: RecordSettings, header: Header = HEADER) -> AsyncIterator[Recorder]:
    """A recorder that records until the end of the context."""
    recorder = Recorder(settings, header)
    recorder.start()
    try:
        yield recorder
    finally:
        await recorder.close()
