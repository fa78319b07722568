"""Summary of a file: its own where that is sound, else made by reading all of it."""

from __future__ import annotations

import os
import struct
import zlib
from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, Schema, Statistics

from cellwatt.channel import Stream
from cellwatt.errors import RecordingError
from cellwatt.files import open_file
from cellwatt.record.chunks import LARGEST_RECORD, parse, parse_attachment
from cellwatt.record.container import MAGIC, RECORD, TAIL, Contents, read_chunk_index
from cellwatt.record.decoder import tracks_of
from cellwatt.record.header import FileName, Header
from cellwatt.record.openfile import HEADER
from cellwatt.record.rows import SampleRows
from cellwatt.record.scan import LARGEST_SUMMARY, Damage, Scan, header_of, read_at, scan


@dataclass(frozen=True, slots=True)
class Survey:
    """A file's header, contents and damage; ``closed`` where it has a valid end of its own."""

    path: Path
    size: int
    header: Header
    contents: Contents
    damage: tuple[Damage, ...]
    closed: bool


def survey(path: Path, *, chunks: bool = True) -> Survey:
    """Content of a file, damaged or not. Without ``chunks`` they may be left out, which is much faster.

    Raises ``RecordingError`` where the file cannot be opened or nothing in it is a recording.
    """
    try:
        with open_file(path) as file:
            summary = read_summary(file, chunks=chunks)
            found = scan(file, path) if summary is None else None
            size = os.fstat(file.fileno()).st_size
            header = _header(file, summary) if summary is not None else None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
    if summary is not None:
        damage = _undeclared(path, summary)
        return Survey(path, size, header or guess_header(path, summary), summary, damage, closed=True)
    assert found is not None
    if not found.contents.chunks and found.header is None:
        raise RecordingError(f"{path}: holds nothing that is a recording")
    return _from_scan(found)


def _from_scan(found: Scan) -> Survey:
    header = found.header or guess_header(found.path, found.contents)
    damage = (*found.damage, *_undeclared(found.path, found.contents))
    return Survey(found.path, found.size, header, found.contents, damage, found.closed)


def _undeclared(path: Path, contents: Contents) -> tuple[Damage, ...]:
    """Channels whose declaration is damaged; the others are read."""
    return tuple(Damage(path, 0, 0, wrong) for wrong in tracks_of(contents.channels)[1])


def read_summary(file: FileIO, *, chunks: bool = True) -> Contents | None:
    """The summary at a file's end; ``None`` where there is none or its checksum is wrong. Raises ``OSError``."""
    size = os.fstat(file.fileno()).st_size
    tail = read_at(file, TAIL, max(size - TAIL, 0))
    if len(tail) < TAIL or not tail.endswith(MAGIC) or tail[0] != Opcode.FOOTER:
        return None
    start, _, crc = struct.unpack_from("<QQI", tail, RECORD.size)
    if not 0 < start <= size - TAIL or size - TAIL - start > LARGEST_SUMMARY:
        return None
    summary = read_at(file, size - TAIL - start, start)
    if crc and zlib.crc32(tail[: RECORD.size + 16], zlib.crc32(summary)) != crc:
        return None
    try:
        return _contents(summary, chunks=chunks)
    except (ValueError, struct.error):
        return None


def _contents(summary: bytes, *, chunks: bool) -> Contents:
    contents, at = Contents(), 0
    while at < len(summary):
        opcode, length = RECORD.unpack_from(summary, at)
        at += RECORD.size + length
        if opcode == Opcode.CHUNK_INDEX:
            if chunks:
                contents.chunks.append(read_chunk_index(summary[at - length : at]))
            continue
        body = summary[at - length : at]
        if opcode == Opcode.SCHEMA:
            contents.define([parse(Schema, body)])
        elif opcode == Opcode.CHANNEL:
            contents.define([parse(Channel, body)])
        elif opcode == Opcode.ATTACHMENT_INDEX:
            contents.attachments.append(parse(AttachmentIndex, body))
        elif opcode == Opcode.STATISTICS:
            statistics = parse(Statistics, body)
            contents.counts.update(statistics.channel_message_counts)
            contents.start, contents.end = statistics.message_start_time, statistics.message_end_time
    return contents


def _header(file: FileIO, contents: Contents) -> Header | None:
    for index in contents.attachments:
        if index.name == HEADER:
            record = read_at(file, min(index.length, LARGEST_RECORD), index.offset)
            try:
                return header_of(parse_attachment(record[RECORD.size :]).data)
            except ValueError:
                return None
    return None


def guess_header(path: Path, contents: Contents) -> Header:
    """Header of a file that lost it: its name tells cell and session, its channels the streams."""
    streams: dict[str, tuple[Stream, ...]] = {}
    for track in tracks_of(contents.channels)[0].values():
        if isinstance(track.rows, SampleRows):
            streams[track.rows.source] = (*streams.get(track.rows.source, ()), track.rows.stream)
    name = FileName.parse(path.name) or FileName(contents.start, 0, path.stem)
    return Header(site="", cell=name.cell, session=name.session, number=name.number, streams=streams)
