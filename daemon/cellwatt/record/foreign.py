"""MCAP files that cellwatt did not write: recognised, read record by record, and described by their topics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from io import FileIO
from typing import Final

import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.records import Channel, Chunk, McapRecord, Schema
from mcap.records import Header as McapHeader
from mcap.stream_reader import StreamReader, breakup_chunk

from cellwatt.errors import RecordingError
from cellwatt.record.chunks import read_at
from cellwatt.record.container import MAGIC, PRELUDE, Contents
from cellwatt.record.decoder import tracks_of
from cellwatt.record.header import Header

LARGEST: Final = 1 << 28
"""Largest size of a record in bytes, compressed or not; a record of some kB may claim any size."""
MOST: Final = 12
"""Largest number of topics that a message lists."""


class ForeignError(RecordingError):
    """An MCAP file that cellwatt did not write."""


def is_foreign(file: FileIO, contents: Contents, header: Header | None) -> bool:
    """True for an MCAP file without anything of cellwatt: neither first bytes, nor header, nor channel."""
    first = read_at(file, len(PRELUDE), 0)
    if header is not None or first == PRELUDE or not first.startswith(MAGIC):
        return False
    return all(track.rows is None for track in tracks_of(contents.channels)[0].values())


def held(file: FileIO, contents: Contents) -> str:
    """Topics of any MCAP file, for a message: ``/joint_states (ros2, cdr) of sensor_msgs/msg/JointState``.

    A file without a summary is read up to its end, or to the point where it is cut off.
    """
    profile, found = "", Contents(dict(contents.schemas), dict(contents.channels))
    with suppress(ValueError):
        for record in records(file):
            if isinstance(record, McapHeader):
                profile = record.profile
            elif isinstance(record, Schema | Channel):
                found.define([record])
            if contents.channels:
                break
    return listed(described(profile, each, found.schemas.get(each.schema_id)) for each in found.channels.values())


def described(profile: str, channel: Channel, schema: Schema | None) -> str:
    """Describe a channel for a message."""
    form = ", ".join(filter(None, (profile or (schema.encoding if schema else ""), channel.message_encoding)))
    return f"{channel.topic} ({form or 'no encoding'})" + (f" of {schema.name}" if schema else "")


def listed(topics: Iterable[str]) -> str:
    """List topics for a message, sorted, at most ``MOST``."""
    unique = sorted(set(topics))
    return "; ".join(unique[:MOST]) + ("; …" if len(unique) > MOST else "") or "no topics"


def records(file: FileIO) -> Iterator[McapRecord]:
    """The records of an MCAP file in order, also those in chunks. Raises ``ValueError`` if it is damaged."""
    file.seek(0)
    try:
        with open(file.fileno(), "rb", closefd=False) as buffered:  # mcap would close the file if it buffered it itself
            for record in StreamReader(buffered, emit_chunks=True, record_size_limit=LARGEST).records:
                if not isinstance(record, Chunk):
                    yield record
                else:
                    yield from breakup_chunk(_unpacked(record), validate_crc=True)
    except ValueError:
        raise
    except Exception as error:  # McapError, struct.error, and errors of lz4 and zstd
        raise ValueError(str(error) or "it ends within a record") from error


def _unpacked(chunk: Chunk) -> Chunk:
    """Decompress a chunk. Raises ``ValueError`` if its data exceed the size that it claims, or ``LARGEST``."""
    size = chunk.uncompressed_size
    if size > LARGEST:
        raise ValueError(f"a chunk claims {size:,} bytes")
    match chunk.compression:
        case "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
        case "lz4":
            data = LZ4FrameDecompressor().decompress(chunk.data, size + 1)
        case _:
            return chunk
    if len(data) > size:
        raise ValueError(f"a chunk unpacks to more than the {size:,} bytes that it claims")
    return replace(chunk, compression="", data=data)
