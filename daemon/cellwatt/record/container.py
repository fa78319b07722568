"""The MCAP container as bytes: whole chunks with their indexes, and the end of a file.

Written here rather than with ``mcap.writer.Writer``, which takes one message a call: blocks of records are
written as they are, a chunk and its indexes in one piece, and a torn file can be closed after its last
whole chunk. Layout: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")
"""Head of every record: opcode, length of the body."""
CHUNK_HEAD = struct.Struct("<QQQI")
"""Earliest and latest log time, uncompressed size, CRC-32 of the uncompressed records."""
MESSAGE_HEAD = struct.Struct("<HIQ")
"""Channel, sequence, log time (the publish time and the data follow)."""
FRAMED_MESSAGE = struct.Struct("<BQHIQQ")
COMPRESSION = b"\x04\x00\x00\x00zstd"
TAIL = 9 + 20 + len(MAGIC)
"""Length of footer and magic."""


class Chunk(NamedTuple):
    """Position of a chunk in its file; ``indexes`` holds (channel, offset of its message index)."""

    offset: int
    length: int
    start: int
    end: int
    compressed: int
    uncompressed: int
    indexes: tuple[tuple[int, int], ...]
    index_length: int


class Chunks:
    """The chunks of a file in order, stored as records of the summary: a tenth of the memory of objects."""

    def __init__(self) -> None:
        self._records: list[bytes] = []
        self._holding: dict[int, array[int]] = {}

    def append(self, chunk: Chunk) -> None:
        """Append a chunk; another thread may read meanwhile."""
        self._records.append(chunk_index(chunk))
        for channel, _ in chunk.indexes:
            self._holding.setdefault(channel, array("L")).append(len(self._records) - 1)

    def holding(self, channel: int) -> Chunks:
        """The present chunks in which a channel has messages."""
        found = Chunks()
        found._records = [self._records[at] for at in self._holding.get(channel, ())]
        return found

    def record(self) -> bytes:
        """All chunks as bytes of the summary."""
        return b"".join(self._records)

    def __len__(self) -> int:
        return len(self._records)

    def __getitem__(self, at: int) -> Chunk:
        return read_chunk_index(self._records[at][RECORD.size :])

    def __iter__(self) -> Iterator[Chunk]:
        return map(self.__getitem__, range(len(self)))


@dataclass
class Contents:
    """Content of a file's summary: definitions by id, chunks in file order, messages by channel."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: Chunks = field(default_factory=Chunks)
    counts: Counter[int] = field(default_factory=Counter)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    start: int = 0
    end: int = 0

    def add_chunk(self, chunk: Chunk, counts: Mapping[int, int]) -> None:
        """Add a chunk at the end of the file."""
        self.start = min(self.start, chunk.start) if self.chunks else chunk.start
        self.end = max(self.end, chunk.end)
        self.chunks.append(chunk)
        self.counts.update(counts)

    def by_topic(self) -> Counter[str]:
        """Messages by topic."""
        found = Counter[str]()
        for number, count in self.counts.items():
            if number in self.channels:
                found[self.channels[number].topic] += count
        return found

    def define(self, records: Iterable[Schema | Channel]) -> None:
        """Add schemas and channels found in a chunk."""
        for record in records:
            if isinstance(record, Schema):
                self.schemas[record.id] = record
            else:
                self.channels[record.id] = record


def record_bytes(record: McapRecord) -> bytes:
    """Encode an MCAP record."""
    builder: Any = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


PRELUDE = MAGIC + record_bytes(Header(profile="", library="cellwatt"))
"""The first bytes of every recording."""


def framed(opcode: int, body: bytes) -> bytes:
    """Encode a record from its body."""
    return RECORD.pack(opcode, len(body)) + body


def message(channel: int, sequence: int, time: int, data: bytes) -> bytes:
    """One message record; times in UTC ns."""
    stamp = time & 0xFFFFFFFFFFFFFFFF
    head = FRAMED_MESSAGE.pack(Opcode.MESSAGE, 22 + len(data), channel, sequence & 0xFFFFFFFF, stamp, stamp)
    return head + data


def attachment(name: str, media_type: str, time: int, data: bytes, offset: int) -> tuple[bytes, AttachmentIndex]:
    """An attachment record to be written at ``offset``, and its entry in the summary."""
    made = Attachment(create_time=time, log_time=time, name=name, media_type=media_type, data=data)
    body = record_bytes(made)
    return body, attachment_index(made, offset, len(body))


def attachment_index(made: Attachment, offset: int, length: int) -> AttachmentIndex:
    """The summary's entry of an attachment whose record of ``length`` bytes is at ``offset``."""
    return AttachmentIndex(
        offset=offset,
        length=length,
        log_time=made.log_time,
        create_time=made.create_time,
        data_size=len(made.data),
        name=made.name,
        media_type=made.media_type,
    )


def chunk_bytes(
    data: bytes, index: Mapping[int, bytes], offset: int, compressor: zstandard.ZstdCompressor
) -> tuple[bytes, Chunk]:
    """A chunk record with its message indexes, to be written at ``offset``.

    ``index`` maps channels, in order of their first message, to pairs of log time and offset (two u64 each).
    """
    times = [np.frombuffer(pairs, "<u8")[::2] for pairs in index.values()]
    start, end = int(min(t.min() for t in times)), int(max(t.max() for t in times))
    packed = compressor.compress(data)
    body = (
        CHUNK_HEAD.pack(start, end, len(data), zlib.crc32(data)) + COMPRESSION + struct.pack("<Q", len(packed)) + packed
    )
    record = framed(Opcode.CHUNK, body)
    indexes, positions = message_indexes(index, offset + len(record))
    return record + indexes, Chunk(offset, len(record), start, end, len(packed), len(data), positions, len(indexes))


def message_indexes(index: Mapping[int, bytes], offset: int) -> tuple[bytes, tuple[tuple[int, int], ...]]:
    """The message index records that follow a chunk, and the offset of each by channel."""
    out, positions = bytearray(), []
    for channel, pairs in index.items():
        positions.append((channel, offset + len(out)))
        out += framed(Opcode.MESSAGE_INDEX, struct.pack("<HI", channel, len(pairs)) + pairs)
    return bytes(out), tuple(positions)


_CHUNK_INDEX = struct.Struct("<QQQQI")


def chunk_index(chunk: Chunk) -> bytes:
    """The summary's record of a chunk."""
    head = _CHUNK_INDEX.pack(chunk.start, chunk.end, chunk.offset, chunk.length, 10 * len(chunk.indexes))
    positions = b"".join(struct.pack("<HQ", channel, offset) for channel, offset in chunk.indexes)
    tail = struct.pack("<QQ", chunk.compressed, chunk.uncompressed)
    return framed(Opcode.CHUNK_INDEX, head + positions + struct.pack("<Q", chunk.index_length) + COMPRESSION + tail)


def read_chunk_index(body: bytes) -> Chunk:
    """Decode a chunk's position from its record in the summary; raises ``struct.error``."""
    start, end, offset, length, size = _CHUNK_INDEX.unpack_from(body)
    at = _CHUNK_INDEX.size
    positions = tuple(struct.unpack_from("<HQ", body, p) for p in range(at, at + size, 10))
    index_length, compression = struct.unpack_from("<QI", body, at + size)
    compressed, uncompressed = struct.unpack_from("<QQ", body, at + size + 12 + compression)
    return Chunk(offset, length, start, end, compressed, uncompressed, positions, index_length)


def closing(contents: Contents, offset: int) -> bytes:
    """The end of the data section, the summary and the footer, to be written at ``offset``."""
    data_end = record_bytes(DataEnd(0))
    start = offset + len(data_end)
    statistics = Statistics(
        attachment_count=len(contents.attachments),
        channel_count=len(contents.channels),
        channel_message_counts=dict(contents.counts),
        chunk_count=len(contents.chunks),
        message_count=contents.counts.total(),
        message_end_time=contents.end,
        message_start_time=contents.start,
        metadata_count=0,
        schema_count=len(contents.schemas),
    )
    groups: list[tuple[Opcode, bytes]] = [
        (Opcode.SCHEMA, b"".join(map(record_bytes, contents.schemas.values()))),
        (Opcode.CHANNEL, b"".join(map(record_bytes, contents.channels.values()))),
        (Opcode.STATISTICS, record_bytes(statistics)),
        (Opcode.CHUNK_INDEX, contents.chunks.record()),
        (Opcode.ATTACHMENT_INDEX, b"".join(map(record_bytes, contents.attachments))),
    ]
    summary, offsets = bytearray(), b""
    for opcode, group in groups:
        if group:
            offsets += record_bytes(SummaryOffset(opcode, start + len(summary), len(group)))
        summary += group
    offsets_start = start + len(summary)
    summary += offsets
    footer = record_bytes(Footer(start, offsets_start, 0))[:-4]
    crc = zlib.crc32(footer, zlib.crc32(summary))
    return b"".join((data_end, bytes(summary), footer, struct.pack("<I", crc), MAGIC))
