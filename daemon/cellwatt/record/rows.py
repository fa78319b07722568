"""Blocks of samples and frames as arrays of MCAP message records, encoded and decoded in one go.

Every message of a channel has the same length, because a double field with a number from 16 to 2047
always takes two bytes of tag and eight of value. A block of n messages, record framing included, is thus
an array of n packed structs, and numpy fills or reads it column by column. Bits pass unchanged.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from cellwatt import protobuf
from cellwatt.batch import Batch, Float
from cellwatt.channel import Channel, Stream
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.protobuf import Field, Kind

Rows = NDArray[np.void]

FIRST_VALUE = 16
MOST_VALUES = 2048 - FIRST_VALUE
"""Channels a stream or a frame may have: beyond them a tag would take three bytes."""

OPCODE_MESSAGE = 5
FRAMING: list[tuple[Any, ...]] = [
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_time", "<u8"),
    ("publish_time", "<u8"),
]
_SIZES = {
    Kind.DOUBLE: ("<f8", protobuf.FIXED64),
    Kind.SFIXED64: ("<i8", protobuf.FIXED64),
    Kind.FIXED32: ("<u4", protobuf.FIXED32),
}

DEVICE_TIME = Field("device_time", 1, Kind.SFIXED64)
BOUND = Field("bound", 2, Kind.SFIXED64)
QUALITY = Field("quality", 3, Kind.FIXED32)
LEFT = Field("block_left", 4, Kind.FIXED32)
"""Samples of the same block that follow: tells where recorded blocks begin and end."""
QUALITIES = Field("quality", 1, Kind.BYTES)
BOUNDS = Field("bound", 2, Kind.SFIXED64, repeated=True)

SAMPLE_FIELDS = (DEVICE_TIME, BOUND, QUALITY, LEFT)
FRAME_FIELDS = (QUALITIES, BOUNDS, LEFT)


def value_fields(names: Sequence[str], fixed: Sequence[Field]) -> tuple[Field, ...]:
    """One double field per channel, numbered from 16."""
    unique = protobuf.identifiers(names, (f.name for f in fixed))
    return tuple(Field(name, FIRST_VALUE + i, Kind.DOUBLE) for i, name in enumerate(unique))


_STREAM: TypeAdapter[Stream] = TypeAdapter(Stream)
_LAYOUT: TypeAdapter[Layout] = TypeAdapter(Layout)


class RowType:
    """The struct of one message record: ``fixed`` fields, then ``channels`` doubles.

    Raises ``ValueError`` for more than ``MOST_VALUES`` channels.
    """

    def __init__(self, fixed: Sequence[Field], channels: int) -> None:
        if channels > MOST_VALUES:
            raise ValueError(f"{channels} channels in one stream: a recording takes at most {MOST_VALUES}")
        layout = list(FRAMING)
        prefixes: dict[str, bytes] = {}
        for field in fixed:
            form, shape, prefix = _placement(field, channels)
            prefixes[f"{field.name}_tag"] = prefix
            layout += [(f"{field.name}_tag", "u1", (len(prefix),)), (field.name, form, shape)]
        layout.append(("values", [("tag", "u1", (2,)), ("bits", "<u8")], (channels,)))
        self.dtype = np.dtype(layout)
        self.size = self.dtype.itemsize
        template = np.zeros(1, self.dtype)
        template["opcode"] = OPCODE_MESSAGE
        template["length"] = self.size - 9
        for name, prefix in prefixes.items():
            template[name] = np.frombuffer(prefix, np.uint8)
        for i in range(channels):
            template["values"]["tag"][0, i] = np.frombuffer(protobuf.tag(FIRST_VALUE + i, protobuf.FIXED64), np.uint8)
        self._template = template.tobytes()

    def rows(self, n: int, channel: int, sequence: int) -> Rows:
        """n records with everything that never changes filled in, numbered from ``sequence``."""
        # Repeating bytes is some twenty times as fast as numpy's copying of nested structs.
        rows = np.frombuffer(bytearray(self._template * n), self.dtype)
        rows["channel"] = channel
        if n == 1:
            rows["sequence"] = sequence & 0xFFFFFFFF
            return rows
        rows["sequence"] = np.arange(sequence & 0xFFFFFFFF, (sequence & 0xFFFFFFFF) + n) & 0xFFFFFFFF
        rows["block_left"] = np.arange(n - 1, -1, -1)
        return rows

    def block(self, data: bytes, offset: int) -> Rows:
        """The records of the block that begins at ``offset``; ends early where other records stand between."""
        most = (len(data) - offset) // self.size
        rows: Rows = np.frombuffer(data, self.dtype, most, offset)
        n = min(int(rows[0]["block_left"]) + 1, most)
        rows = rows[:n]
        if n > 1:
            left = rows["block_left"]
            alike = (
                (rows["opcode"] == OPCODE_MESSAGE)
                & (rows["length"] == self.size - 9)
                & (rows["channel"] == rows["channel"][0])
                & (left == left[0] - np.arange(n, dtype=np.uint32))
            )
            if not alike.all():
                rows = rows[: int(np.argmin(alike))]
        return rows


def _placement(field: Field, channels: int) -> tuple[str, tuple[int, ...], bytes]:
    if field.kind is Kind.BYTES:
        return "u1", (channels,), protobuf.tag(field.number, protobuf.LENGTH) + protobuf.varint(channels)
    form, wire = _SIZES[field.kind]
    if field.repeated:
        return form, (channels,), protobuf.tag(field.number, protobuf.LENGTH) + protobuf.varint(8 * channels)
    return form, (), protobuf.tag(field.number, wire)


def _bits(values: Float) -> NDArray[np.uint64]:
    return np.ascontiguousarray(values, np.float64).view(np.uint64)


def _values(rows: Rows) -> Float:
    return np.ascontiguousarray(rows["values"]["bits"]).view(np.float64)


def _whole(sequence: int, first: int) -> int:
    """A sequence number from its low 32 bits and an earlier one less than 2³² before it."""
    return first + (sequence - first & 0xFFFFFFFF)


class BlockRows(Protocol):
    """Blocks of one kind as records of one MCAP channel; the same for samples and frames."""

    fixed: tuple[Field, ...]
    """Fields of every record of this kind, before those of its ``channels``."""
    channels: tuple[Channel | FrameChannel, ...]

    @property
    def declaration(self) -> dict[str, str]:
        """Text that ``declared_rows`` reads."""
        ...

    def fits(self, block: Any, /) -> bool:
        """Tell whether a block is of this kind."""
        ...

    def encode(self, block: Any, channel: int, /) -> Rows:
        """The records of a block."""
        ...


class SampleRows:
    """Batches of one stream as records of one MCAP channel."""

    fixed: tuple[Field, ...] = SAMPLE_FIELDS

    def __init__(self, source: str, stream: Stream) -> None:
        self.source = source
        self.stream = stream
        self.channels: tuple[Channel | FrameChannel, ...] = stream.channels
        self._timed = RowType(SAMPLE_FIELDS, len(self.channels))
        self._untimed = RowType(SAMPLE_FIELDS[1:], len(self.channels))

    @property
    def declaration(self) -> dict[str, str]:
        """See ``BlockRows.declaration``."""
        return {"source": self.source, "stream": self.stream.name, "declaration": json.dumps(asdict(self.stream))}

    def fits(self, batch: Batch) -> bool:
        """See ``BlockRows.fits``; most often it is the same object, which spares comparing every channel."""
        return self.stream is batch.stream or self.stream == batch.stream

    def encode(self, batch: Batch, channel: int) -> Rows:
        """The records of a batch; those it was read from, if it has them, differ in the channel alone."""
        if batch.rows is not None:
            rows = np.frombuffer(bytearray(batch.rows.tobytes()), batch.rows.dtype)
            rows["channel"] = channel
            return rows
        row_type = self._untimed if batch.device_time is None else self._timed
        rows = row_type.rows(len(batch), channel, batch.sequence)
        rows["log_time"] = np.ascontiguousarray(batch.time, np.int64).view(np.uint64)
        rows["publish_time"] = batch.arrival & 0xFFFFFFFFFFFFFFFF
        rows["bound"] = batch.bound
        rows["quality"] = batch.quality
        rows["values"]["bits"] = _bits(batch.values)
        if batch.device_time is not None:
            rows["device_time"] = batch.device_time
        return rows

    def decode(self, data: bytes, offset: int, length: int, first: int, *, keep: bool = False) -> tuple[Batch, int]:
        """The batch whose records begin at ``offset``, and where they end.

        ``length`` is the first record's, ``first`` the sequence number at which this file's stream begins. With
        ``keep`` the batch has its rows, and with them all of ``data``.
        Raises ``ValueError`` where the record is not of this stream.
        """
        row_type = next((t for t in (self._timed, self._untimed) if t.size - 9 == length), None)
        if row_type is None:
            raise ValueError(f"a message of {length} bytes does not fit {self.source}/{self.stream.name}")
        rows = row_type.block(data, offset)
        batch = Batch(
            source=self.source,
            stream=self.stream,
            sequence=_whole(int(rows["sequence"][0]), first),
            arrival=int(rows["publish_time"][:1].astype(np.int64)[0]),
            time=rows["log_time"].astype(np.int64),
            bound=rows["bound"].astype(np.int64),
            values=_values(rows),
            quality=rows["quality"].astype(np.uint8),
            device_time=rows["device_time"].astype(np.int64) if row_type is self._timed else None,
        )
        if keep:
            object.__setattr__(batch, "rows", rows)
        return batch, offset + rows.nbytes


class FrameRows:
    """Frames of one layout as records of one MCAP channel."""

    fixed: tuple[Field, ...] = FRAME_FIELDS

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.channels: tuple[Channel | FrameChannel, ...] = layout.channels
        self._type = RowType(FRAME_FIELDS, len(layout.channels))

    @property
    def declaration(self) -> dict[str, str]:
        """See ``BlockRows.declaration``."""
        return {"declaration": json.dumps(asdict(self.layout))}

    def fits(self, frames: Frames) -> bool:
        """See ``BlockRows.fits``."""
        return self.layout is frames.layout or self.layout == frames.layout

    def encode(self, frames: Frames, channel: int) -> Rows:
        """The records of a block of frames."""
        rows = self._type.rows(len(frames), channel, frames.sequence)
        rows["log_time"] = np.ascontiguousarray(frames.time, np.int64).view(np.uint64)
        rows["publish_time"] = rows["log_time"]
        rows["quality"] = frames.quality
        rows["bound"] = frames.bound
        rows["values"]["bits"] = _bits(frames.values)
        return rows

    def decode(self, data: bytes, offset: int, length: int, first: int) -> tuple[Frames, int]:
        """The frames whose records begin at ``offset``, and where they end. Raises ``ValueError``."""
        if self._type.size - 9 != length:
            raise ValueError(f"a message of {length} bytes does not fit frames of {len(self.layout.channels)} channels")
        rows = self._type.block(data, offset)
        frames = Frames(
            layout=self.layout,
            sequence=_whole(int(rows["sequence"][0]), first),
            time=rows["log_time"].astype(np.int64),
            values=_values(rows),
            quality=rows["quality"].astype(np.uint8),
            bound=rows["bound"].astype(np.int64),
        )
        return frames, offset + rows.nbytes


def rows_of(block: Batch | Frames) -> SampleRows | FrameRows:
    """The rows that a block, and others of its kind, are."""
    return SampleRows(block.source, block.stream) if isinstance(block, Batch) else FrameRows(block.layout)


def declared_rows(declaration: Mapping[str, str]) -> SampleRows | FrameRows:
    """The rows that a declaration tells of. Raises ``ValueError`` or ``KeyError`` where it is damaged."""
    if "source" in declaration:
        return SampleRows(declaration["source"], _STREAM.validate_json(declaration["declaration"]))
    return FrameRows(_LAYOUT.validate_json(declaration["declaration"]))
