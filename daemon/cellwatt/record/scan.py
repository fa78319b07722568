"""Finds all readable records of a damaged file.

Records are followed from the start; where that fails, the scan searches byte by byte for the next chunk with a right
checksum, and reports the bytes in between.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.records import Header as McapHeader

from cellwatt.record.chunks import (
    DEFINED,
    LARGEST_RECORD,
    chunk_data,
    definition,
    definitions,
    open_chunk,
    parse,
    parse_attachment,
    read_at,
    read_summary,
    walk,
)
from cellwatt.record.container import (
    CHUNK_HEAD,
    COMPRESSION,
    MAGIC,
    RECORD,
    Chunk,
    Contents,
    attachment_index,
    message_indexes,
)
from cellwatt.record.header import Header
from cellwatt.record.openfile import DEFINITIONS, HEADER

_WINDOW = 1 << 20
_LAST_OPCODE = int(max(Opcode))
_LOW = 0xFFFFFFFF
"""Messages store the low 32 bits of sequence numbers."""
_MARK = RECORD.size + CHUNK_HEAD.size
"""Bytes from the start of a chunk record to the name of its compression, for which the scan searches."""


@dataclass(frozen=True, slots=True)
class Damage:
    """``length`` bytes at ``offset`` of a file that cannot be read; ``what`` is the reason."""

    path: Path
    offset: int
    length: int
    what: str

    def __str__(self) -> str:
        if not self.length:
            return f"{self.path.name}: {self.what}"
        return f"{self.path.name}: {self.length} bytes at {self.offset} cannot be read: {self.what}"


@dataclass
class Scan:
    """Findings of a scan.

    ``end`` is the end of the last whole record of the data, and ``tail`` the message indexes missing there.
    ``closed`` is true if the file has a valid end. ``missing`` counts by topic the messages that are absent
    according to their numbers.
    """

    path: Path
    size: int
    header: Header | None = None
    contents: Contents = field(default_factory=Contents)
    damage: list[Damage] = field(default_factory=list)
    end: int = 0
    tail: bytes = b""
    closed: bool = False
    missing: Counter[str] = field(default_factory=Counter)

    @property
    def torn(self) -> bool:
        """True if all damage lies after the last whole record."""
        return all(d.offset >= self.end for d in self.damage)


def scan(file: FileIO, path: Path) -> Scan:
    """Read a whole file and check every record. Never raises because of the file's content."""
    scanner = _Scanner(file, path)
    scanner.run()
    return scanner.found


class _Scanner:
    def __init__(self, file: FileIO, path: Path) -> None:
        self._file = file
        self.found = Scan(path, os.fstat(file.fileno()).st_size)
        self._numbers: dict[int, list[tuple[int, int, int]]] = {}

    def run(self) -> None:
        found = self.found
        if not found.size:
            return
        if read_at(self._file, len(MAGIC), 0) != MAGIC:
            self._damaged(0, min(len(MAGIC), found.size), "the file does not begin like an MCAP file")
        at = len(MAGIC)
        while at < found.size and not found.closed:
            at = self._record(at)
        self._count_missing()
        self._drop_undefined()

    def _drop_undefined(self) -> None:
        """Drop chunks with a channel of which no copy of the definition is readable."""
        old = self.found.contents
        undefined = old.counts.keys() - old.channels.keys()
        if not undefined:
            return
        new = Contents(old.schemas, old.channels, attachments=old.attachments)
        for chunk in old.chunks:
            if undefined.isdisjoint(number for number, _ in chunk.indexes):
                new.add_chunk(chunk, walk(chunk_data(self._file, chunk)).counts())
            else:
                self._damaged(chunk.offset, chunk.length, "the definitions of its channels are lost")
        self.found.contents = new

    def _damaged(self, offset: int, length: int, what: str) -> None:
        self.found.damage.append(Damage(self.found.path, offset, length, what))

    def _record(self, at: int) -> int:
        """Read the record at ``at``; return the offset of the next."""
        head = read_at(self._file, RECORD.size, at)
        if len(head) < RECORD.size:
            return self._resync(at, "the file ends within a record")
        opcode, length = RECORD.unpack(head)
        after = at + RECORD.size + length
        if not 0 < opcode <= _LAST_OPCODE:
            return self._resync(at, "these bytes are not a record")
        if after > self.found.size:
            return self._resync(at, "the file ends within a record")
        if length > LARGEST_RECORD:
            return self._resync(at, "a record is larger than any of a recording")
        body = read_at(self._file, length, at + RECORD.size)
        try:
            if len(body) < length:
                raise ValueError("the disk cannot read it")
            if opcode == Opcode.CHUNK:
                return self._chunk(at, body)
            self._other(opcode, at, body)
        except ValueError as error:
            return self._resync(at, str(error))
        if opcode != Opcode.DATA_END:
            self.found.end = after
        return after if opcode != Opcode.DATA_END else self.found.size

    def _chunk(self, at: int, body: bytes) -> int:
        opened = open_chunk(body)
        listed = walk(opened.data)
        index = listed.index()
        _check_times(index, opened.start, opened.end)
        after = at + RECORD.size + len(body)
        indexes, positions = message_indexes(index, after)
        length, contents = after - at, self.found.contents
        contents.define(listed.definitions)
        for channel, counted in listed.counts().items():
            self._numbers.setdefault(channel, []).append((listed.first[channel], listed.last[channel], counted))
        sizes = (opened.compressed, len(opened.data))
        contents.add_chunk(
            Chunk(at, length, opened.start, opened.end, *sizes, positions, len(indexes)), listed.counts()
        )
        if read_at(self._file, len(indexes), after) == indexes:
            self.found.end, self.found.tail = after + len(indexes), b""
            return self.found.end
        self.found.end, self.found.tail = after, indexes
        if after == self.found.size:
            self._damaged(after, 0, "the file ends before the index of its last chunk")
            return after
        return self._resync(after, "the index of a chunk is wrong")

    def _other(self, opcode: int, at: int, body: bytes) -> None:
        contents = self.found.contents
        if opcode == Opcode.HEADER and at == len(MAGIC):
            parse(McapHeader, body)
        elif opcode == Opcode.ATTACHMENT:
            self._attachment(at, body)
        elif opcode in DEFINED:
            contents.define(definition(opcode, body))
        elif opcode == Opcode.DATA_END:
            self.found.closed = read_summary(self._file) is not None
            if not self.found.closed:
                self._damaged(at, self.found.size - at, "the summary is damaged")
        else:
            raise ValueError("a record of a kind that does not belong there")

    def _attachment(self, at: int, body: bytes) -> None:
        read = parse_attachment(body)
        if read.name == HEADER:
            self.found.header = Header.from_json(read.data)
        elif read.name == DEFINITIONS:
            self.found.contents.define(definitions(read.data))
        self.found.contents.attachments.append(attachment_index(read, at, RECORD.size + len(body)))

    def _count_missing(self) -> None:
        """Count the numbers that are missing between the messages found."""
        for channel, runs in self._numbers.items():
            definition = self.found.contents.channels.get(channel)
            if definition is None:
                continue
            expected = _first(definition) & _LOW
            for first, last, counted in runs:
                absent = (last - expected + 1 & _LOW) - counted
                # Numbers that run backwards are not gaps.
                if 0 < absent < 1 << 31 and first - expected & _LOW < 1 << 31:
                    self.found.missing[definition.topic] += absent
                expected = last + 1

    def _resync(self, at: int, what: str) -> int:
        """Offset of the next whole chunk after ``at``, or of the end of the file."""
        after = self._next_chunk(at + 1)
        self._damaged(at, after - at, what)
        return after

    def _next_chunk(self, start: int) -> int:
        at = start
        while at < self.found.size:
            window = read_at(self._file, _WINDOW, at)
            position = window.find(COMPRESSION)
            while position >= 0:
                if (candidate := at + position - _MARK) >= start and self._is_chunk(candidate):
                    return candidate
                position = window.find(COMPRESSION, position + 1)
            at += _WINDOW - len(COMPRESSION)
        return self.found.size

    def _is_chunk(self, at: int) -> bool:
        opcode, length = RECORD.unpack(read_at(self._file, RECORD.size, at))
        if opcode != Opcode.CHUNK or length > LARGEST_RECORD or at + RECORD.size + length > self.found.size:
            return False
        try:
            walk(open_chunk(read_at(self._file, length, at + RECORD.size)).data)
        except ValueError:
            return False
        return True


def _first(definition: Channel) -> int:
    """The first number of a channel; 0 if the definition lacks it, or is damaged."""
    try:
        return int(definition.metadata.get("first", 0))
    except ValueError:
        return 0


def _check_times(index: dict[int, bytes], start: int, end: int) -> None:
    times = np.concatenate([np.frombuffer(pairs, "<u8")[::2] for pairs in index.values()] or [np.zeros(1, "<u8")])
    if int(times.min()) != start or int(times.max()) != end:
        raise ValueError("a chunk's times are wrong")
