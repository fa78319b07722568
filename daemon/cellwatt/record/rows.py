"""Blocks of samples and frames as arrays of MCAP message records, encoded and decoded as a whole.

Every message of a channel has the same length, because a double field with a number from 16 to 2047
always takes two bytes of tag and eight of value. A block of n messages, record framing included, is thus
an array of n packed structs, and numpy fills or reads it column by column. Bits pass unchanged.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from cellwatt import protobuf
from cellwatt.batch import Batch
from cellwatt.channel import Channel, Stream
from cellwatt.frames import FrameChannel, Frames, Layout
from cellwatt.protobuf import Field, Kind

Rows = NDArray[np.void]

FIRST_VALUE = 16
MOST_VALUES = 2048 - FIRST_VALUE
"""Largest number of channels of a stream or a frame: with more, a tag would take three bytes."""

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
"""Number of following samples in the same block: marks where recorded blocks begin and end."""
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
        """n records with the constant fields filled in, numbered from ``sequence``."""
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
        """The records of the block that begins at ``offset``, up to the first record of another channel."""
        most = (len(data) - offset) // self.size
        rows: Rows = np.frombuffer(data, self.dtype, most, offset)
        n = min(int(rows[0]["block_left"]) + 1, most)
        rows = rows[:n]
        if n > 1:
            remaining = rows["block_left"]
            alike = (
                (rows["opcode"] == OPCODE_MESSAGE)
                & (rows["length"] == self.size - 9)
                & (rows["channel"] == rows["channel"][0])
                & (remaining == remaining[0] - np.arange(n, dtype=np.uint32))
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


class BlockRows:
    """Blocks of one kind as records of one MCAP channel; the same for samples and frames.

    ``fixed`` are the fields of every record of this kind, before those of its ``channels``; ``about`` names the kind.
    """

    fixed: tuple[Field, ...]

    def __init__(self, declared: Stream | Layout, about: str, *fixed: tuple[Field, ...]) -> None:
        self.channels: tuple[Channel | FrameChannel, ...] = declared.channels
        self._declared, self._about = declared, about
        self._types = [RowType(fields, len(self.channels)) for fields in fixed]

    @property
    def declaration(self) -> dict[str, str]:
        """Text that ``declared_rows`` reads."""
        return {"declaration": json.dumps(asdict(self._declared))}

    def fits(self, block: Batch | Frames) -> bool:
        """True if a block is of this kind; usually it has the same object, which avoids comparing channels."""
        declared = block.stream if isinstance(block, Batch) else block.layout
        return declared is self._declared or declared == self._declared

    def encode(self, block: Batch | Frames, channel: int) -> Rows:
        """The records of a block; if it has the rows that it was read from, only their channel is replaced."""
        of_device = None
        if isinstance(block, Batch):
            if block.rows is not None:
                rows = np.frombuffer(bytearray(block.rows.tobytes()), block.rows.dtype)
                rows["channel"] = channel
                return rows
            of_device = block.device_time
        rows = self._types[0 if of_device is None else 1].rows(len(block), channel, block.sequence)
        rows["log_time"] = np.ascontiguousarray(block.time, np.int64).view(np.uint64)
        rows["publish_time"] = block.arrival & 0xFFFFFFFFFFFFFFFF if isinstance(block, Batch) else rows["log_time"]
        rows["bound"] = block.bound
        rows["quality"] = block.quality
        rows["values"]["bits"] = np.ascontiguousarray(block.values, np.float64).view(np.uint64)
        if of_device is not None:
            rows["device_time"] = of_device
        return rows

    def _decoded(self, data: bytes, offset: int, length: int, first: int) -> tuple[Rows, dict[str, Any]]:
        """The records of the block that begins at ``offset``, and the fields common to batches and frames."""
        row_type = next((t for t in self._types if t.size - 9 == length), None)
        if row_type is None:
            raise ValueError(f"a message of {length} bytes does not fit {self._about}")
        rows = row_type.block(data, offset)
        return rows, {
            # The record stores the low 32 bits of a number.
            "sequence": first + (int(rows["sequence"][0]) - first & 0xFFFFFFFF),
            "time": rows["log_time"].astype(np.int64),
            "bound": rows["bound"].astype(np.int64),
            "values": np.ascontiguousarray(rows["values"]["bits"]).view(np.float64),
            "quality": rows["quality"].astype(np.uint8),
        }


class SampleRows(BlockRows):
    """Batches of one stream as records of one MCAP channel."""

    fixed = SAMPLE_FIELDS

    def __init__(self, source: str, stream: Stream) -> None:
        super().__init__(stream, f"{source}/{stream.name}", SAMPLE_FIELDS[1:], SAMPLE_FIELDS)
        self.source, self.stream = source, stream

    @property
    def declaration(self) -> dict[str, str]:
        """See ``BlockRows.declaration``."""
        return {"source": self.source, "stream": self.stream.name, **super().declaration}

    def decode(self, data: bytes, offset: int, length: int, first: int, *, keep: bool = False) -> tuple[Batch, int]:
        """The batch whose records begin at ``offset``, and the offset of their end.

        ``length`` is the first record's, ``first`` the sequence number at which this file's stream begins. With
        ``keep`` the batch refers to its rows, and so holds all of ``data`` in memory.
        Raises ``ValueError`` if the record is not of this stream.
        """
        rows, common = self._decoded(data, offset, length, first)
        arrival = int(rows["publish_time"][:1].astype(np.int64)[0])
        device_time = rows["device_time"].astype(np.int64) if "device_time" in (rows.dtype.names or ()) else None
        batch = Batch(self.source, self.stream, arrival=arrival, device_time=device_time, **common)
        if keep:
            object.__setattr__(batch, "rows", rows)
        return batch, offset + rows.nbytes


class FrameRows(BlockRows):
    """Frames of one layout as records of one MCAP channel."""

    fixed = FRAME_FIELDS

    def __init__(self, layout: Layout) -> None:
        super().__init__(layout, f"frames of {len(layout.channels)} channels", FRAME_FIELDS)
        self.layout = layout

    def decode(self, data: bytes, offset: int, length: int, first: int) -> tuple[Frames, int]:
        """The frames whose records begin at ``offset``, and the offset of their end. Raises ``ValueError``."""
        rows, common = self._decoded(data, offset, length, first)
        return Frames(self.layout, **common), offset + rows.nbytes


def rows_of(block: Batch | Frames) -> SampleRows | FrameRows:
    """The rows for a block and others of its kind."""
    return SampleRows(block.source, block.stream) if isinstance(block, Batch) else FrameRows(block.layout)


def declared_rows(declaration: Mapping[str, str]) -> SampleRows | FrameRows:
    """The rows that a declaration describes. Raises ``ValueError`` or ``KeyError`` if it is damaged."""
    return _declared(declaration.get("source"), declaration["declaration"])


@lru_cache(64)  # the files of months have the same few declarations
def _declared(source: str | None, text: str) -> SampleRows | FrameRows:
    return FrameRows(_LAYOUT.validate_json(text)) if source is None else SampleRows(source, _STREAM.validate_json(text))
