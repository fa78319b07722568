"""Reads MCAP records that may be damaged: every fault raises ``ValueError`` with a reason in words."""

from __future__ import annotations

import os
import struct
import threading
import zlib
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO, FileIO
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, AttachmentIndex, Channel, McapRecord, Schema, Statistics, SummaryOffset

from cellwatt.record.container import CHUNK_HEAD, MAGIC, MESSAGE_HEAD, RECORD, TAIL, Chunk, Contents, read_chunk_index

LARGEST_CHUNK = 1 << 25
"""Largest uncompressed size of a chunk in bytes; a larger one is damaged or made to fill the memory. Chunks of the
recorder have some 2**20 plus the last block, those of other writers usually up to 2**23.
"""
LARGEST_RECORD = LARGEST_CHUNK + (1 << 20)
"""Largest size of a record on disk in bytes."""

LARGEST_SUMMARY = 1 << 28
"""Largest size of a summary in bytes: definitions, and some 300 bytes for each chunk."""

SHORTEST_MESSAGE = MESSAGE_HEAD.size + 8
"""Bytes before a message's data; the publish time is the last of them."""

DEFINED: Final[Mapping[int, type[Schema | Channel]]] = {Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel}

R = TypeVar("R", bound=McapRecord)


def parse(kind: type[R], body: bytes) -> R:
    """Decode a schema, channel or entry of the summary from its body."""
    reader: Any = kind
    try:
        record: R = reader.read(ReadDataStream(BytesIO(body)))
    except (McapError, struct.error, UnicodeDecodeError, OverflowError):  # the last: a length beyond 63 bits
        raise ValueError(f"a {kind.__name__.lower()} record is damaged") from None
    return record


def parse_attachment(body: bytes) -> Attachment:
    """Decode an attachment and compare its checksum."""
    if len(body) < 4 or zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
        raise ValueError("an attachment's checksum is wrong")
    return parse(Attachment, body)


class Opened(NamedTuple):
    """The records of a chunk, its earliest and latest log time, and its compressed size."""

    data: bytes
    start: int
    end: int
    compressed: int


def open_chunk(body: bytes) -> Opened:
    """Decode a chunk from the body of its record and compare its checksum."""
    try:
        start, end, size, crc = CHUNK_HEAD.unpack_from(body)
        at = CHUNK_HEAD.size
        (name_length,) = struct.unpack_from("<I", body, at)
        compression = body[at + 4 : at + 4 + name_length]
        (packed_length,) = struct.unpack_from("<Q", body, at + 4 + name_length)
    except struct.error:
        raise ValueError("the head of a chunk is cut") from None
    packed = body[at + 12 + name_length :]
    if packed_length != len(packed) or size > LARGEST_CHUNK:
        raise ValueError("a chunk's length is wrong")
    data = _decompress(packed, compression, size)
    if len(data) != size or zlib.crc32(data) != crc:
        raise ValueError("a chunk's checksum is wrong")
    return Opened(data, start, end, packed_length)


_threads = threading.local()


def _decompressor() -> zstandard.ZstdDecompressor:
    """One per thread: creating one costs more than a small chunk, and threads must not share one."""
    found: zstandard.ZstdDecompressor | None = getattr(_threads, "decompressor", None)
    if found is None:
        found = _threads.decompressor = zstandard.ZstdDecompressor()
    return found


def _decompress(packed: bytes, compression: bytes, size: int) -> bytes:
    if compression == b"":
        return packed
    if compression != b"zstd":
        raise ValueError(f"a chunk is compressed with {compression[:20]!r}, not zstd")
    try:
        # A damaged frame may ask for any amount of memory: its declared size is compared first.
        if zstandard.get_frame_parameters(packed).content_size != size:
            raise ValueError("a chunk's size is wrong")
        return _decompressor().decompress(packed, max_output_size=size)
    except zstandard.ZstdError:
        raise ValueError("a chunk cannot be decompressed") from None


@dataclass(slots=True)
class Walk:
    """Content of a chunk: ``definitions``; by channel flat ``pairs`` of log time and offset, and the ``first`` and
    ``last`` sequence number.
    """

    definitions: list[Schema | Channel] = field(default_factory=list)
    pairs: dict[int, array[int]] = field(default_factory=dict)
    first: dict[int, int] = field(default_factory=dict)
    last: dict[int, int] = field(default_factory=dict)

    def index(self) -> dict[int, bytes]:
        """The pairs in the form of message indexes."""
        return {channel: np.asarray(pairs, "<u8").tobytes() for channel, pairs in self.pairs.items()}

    def counts(self) -> dict[int, int]:
        """Messages by channel."""
        return {channel: len(pairs) // 2 for channel, pairs in self.pairs.items()}


def records_in(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Opcode, offset and length of the body of each record; they must fill the data exactly. Raises ``ValueError``."""
    at, end = 0, len(data)
    while at < end:
        if at + RECORD.size > end:
            raise ValueError("a record is cut")
        opcode, length = RECORD.unpack_from(data, at)
        if at + RECORD.size + length > end:
            raise ValueError("the last record is cut")
        yield opcode, at + RECORD.size, length
        at += RECORD.size + length


def walk(data: bytes) -> Walk:
    """List the records of a chunk, which must fill it exactly."""
    found = Walk()
    pairs, last = found.pairs, found.last
    for opcode, at, length in records_in(data):
        if opcode != Opcode.MESSAGE:
            found.definitions += definition(opcode, data[at : at + length])
            continue
        if length < SHORTEST_MESSAGE:
            raise ValueError("a message in a chunk is cut")
        channel, sequence, time = MESSAGE_HEAD.unpack_from(data, at)
        if channel not in pairs:
            pairs[channel] = array("Q")
            found.first[channel] = sequence
        last[channel] = sequence
        pairs[channel].extend((time, at - RECORD.size))
    return found


def definitions(data: bytes) -> list[Schema | Channel]:
    """Schemas and channels of consecutive records; other records are ignored."""
    return [found for opcode, at, length in records_in(data) for found in definition(opcode, data[at : at + length])]


def definition(opcode: int, body: bytes) -> list[Schema | Channel]:
    """The schema or channel that a record holds; empty for records of other kinds."""
    return [parse(DEFINED[opcode], body)] if opcode in DEFINED else []


def read_at(file: FileIO, length: int, offset: int) -> bytes:
    """Up to ``length`` bytes, limited by the end of the file; empty if the disk cannot read them."""
    try:
        # A damaged file may ask for any length: memory is allocated only for bytes that exist.
        there = os.fstat(file.fileno()).st_size - offset
        return os.pread(file.fileno(), min(length, there), offset) if there > 0 else b""
    except OSError:
        return b""


def chunk_data(file: FileIO, chunk: Chunk) -> bytes:
    """The records of a chunk; raises ``ValueError`` if it is damaged."""
    if chunk.length > LARGEST_RECORD:
        raise ValueError("a chunk's length is wrong")
    return open_chunk(read_at(file, chunk.length, chunk.offset)[RECORD.size :]).data


def read_summary(file: FileIO, *, chunks: bool = True) -> Contents | None:
    """The summary at a file's end; ``None`` if there is none or its checksum is wrong. Raises ``OSError``."""
    size = os.fstat(file.fileno()).st_size
    tail = read_at(file, TAIL, max(size - TAIL, 0))
    if len(tail) < TAIL or not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
        return None
    start, offsets, crc = struct.unpack_from("<QQI", tail, RECORD.size)
    if not 0 < start <= size - TAIL or size - TAIL - start > LARGEST_SUMMARY:
        return None
    summary = read_at(file, size - TAIL - start, start)
    if crc and zlib.crc32(tail[: RECORD.size + 16], zlib.crc32(summary)) != crc:
        return None
    try:
        return _contents(summary if chunks or not offsets else _without_chunks(summary, start, offsets - start))
    except (ValueError, struct.error):
        return None


def _without_chunks(summary: bytes, start: int, offsets: int) -> bytes:
    """A summary, which is at ``start`` in its file, without its thousands of chunks; its ``offsets`` tell where."""
    for _, at, length in records_in(known := summary[offsets:]):
        group = parse(SummaryOffset, known[at : at + length])
        if group.group_opcode == Opcode.CHUNK_INDEX:
            first = group.group_start - start
            return summary[:first] + summary[first + group.group_length :]
    return summary


def _contents(summary: bytes) -> Contents:
    contents = Contents()
    for opcode, at, length in records_in(summary):
        body = summary[at : at + length]
        contents.define(definition(opcode, body))
        if opcode == Opcode.CHUNK_INDEX:
            contents.chunks.append(read_chunk_index(body))
        elif opcode == Opcode.ATTACHMENT_INDEX:
            contents.attachments.append(parse(AttachmentIndex, body))
        elif opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, body)
            contents.counts.update(statistics.channel_message_counts)
            contents.start, contents.end = statistics.message_start_time, statistics.message_end_time
    return contents
