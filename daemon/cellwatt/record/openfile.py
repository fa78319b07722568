"""One recording file while it is written."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import struct
from io import FileIO
from pathlib import Path

import numpy as np
import zstandard
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from cellwatt.files import sync_folder, write_all
from cellwatt.record.container import (
    PRELUDE,
    Contents,
    attachment,
    chunk_bytes,
    closing,
    message,
    record_bytes,
)
from cellwatt.record.header import PART, Header

HEADER = "header.json"
DEFINITIONS = "definitions"
"""Names of attachments: the origin of the file, and copies of the definitions in the chunks."""
REPEAT_AFTER = 64
"""Definitions are copied before their chunk and again this many chunks later, so that one bad sector spares a copy."""

_PAIR = struct.Struct("<QQ")
"""Log time and offset of a message, as its chunk's index holds them."""


def create(path: Path) -> FileIO:
    """Create a file that is locked until closed, so that nobody repairs it meanwhile. Raises ``OSError``."""
    file = FileIO(path, "xb+")
    lock(file)
    return file


def lock(file: FileIO) -> None:
    """Lock a file exclusively; raises ``BlockingIOError`` if another process has locked it.

    Does nothing on a file system without locks (some network shares): use one daemon per folder there.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL):
            raise


class DisplacedError(OSError):
    """The file being written is no longer at the path where readers look for it; the text is the reason alone."""

    def __init__(self, reason: str) -> None:
        super().__init__(errno.ESTALE, reason)


def check_place(descriptor: int, path: Path) -> None:
    """Raise ``DisplacedError`` unless an open file is the one at ``path``."""
    mine = os.fstat(descriptor)
    try:
        there = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        there = None
    except OSError:
        return  # the folder cannot be read any more: that says nothing about the file
    if there is None or not os.path.samestat(there, mine):
        how = "moved away, or something is mounted over its folder," if mine.st_nlink else "removed"
        raise DisplacedError(f"{path.name} was {how} while it was written")


class OpenFile:
    """An MCAP file being written; every method that writes raises ``OSError``.

    After such an error only ``abandon`` may be called. ``size`` is the length in bytes of the whole records on disk,
    ``waiting`` that of the chunk in memory.
    """

    def __init__(self, path: Path, header: Header) -> None:
        self.path = path
        self.part = path.with_name(path.name + PART)
        self.contents = Contents()
        self.size = 0
        self._repeat_at = -1
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._begin()
        self._file = create(self.part)
        try:
            body, index = attachment(
                HEADER, "application/json", header.session, header.to_json().encode(), len(PRELUDE)
            )
            self._write(PRELUDE + body)
        except OSError:
            self.abandon()
            raise
        self.contents.attachments.append(index)

    def _begin(self) -> None:
        self._pieces: list[bytes] = []
        self.waiting = 0
        self._index: dict[int, list[bytes]] = {}
        self._defined = False

    @property
    def next_channel(self) -> int:
        """The number that the next channel defined will have."""
        return len(self.contents.channels) + 1

    def define(self, topic: str, encoding: str, schema: Schema, metadata: dict[str, str]) -> int:
        """Define a channel with its own schema (``schema.id`` is set here); return the channel's number."""
        number = schema.id = self.next_channel
        channel = Channel(number, topic, encoding, metadata, number)
        for record in (schema, channel):
            self._put(record_bytes(record))
        self._defined = True
        self.contents.define((schema, channel))
        return number

    def add_rows(self, channel: int, rows: NDArray[np.void]) -> None:
        """Add a block of message records of equal length (see ``rows``) to the chunk."""
        if len(rows) == 1:
            pairs = _PAIR.pack(rows["log_time"][0], self.waiting)
        else:
            table = np.empty((len(rows), 2), "<u8")
            table[:, 0] = rows["log_time"]
            table[:, 1] = np.arange(self.waiting, self.waiting + rows.nbytes, rows.itemsize)
            pairs = table.tobytes()
        self._put(rows.tobytes())
        self._index.setdefault(channel, []).append(pairs)

    def add_message(self, channel: int, sequence: int, time: int, data: bytes) -> None:
        """Add one message to the chunk."""
        pairs = _PAIR.pack(time & 0xFFFFFFFFFFFFFFFF, self.waiting)
        self._put(message(channel, sequence, time, data))
        self._index.setdefault(channel, []).append(pairs)

    def _put(self, piece: bytes) -> None:
        self._pieces.append(piece)
        self.waiting += len(piece)

    def write_chunk(self) -> None:
        """Write the messages added since the last chunk, in one piece."""
        if not self._index:
            return
        front, indexed = b"", None
        if self._defined:
            self._repeat_at = len(self.contents.chunks) + REPEAT_AFTER
        if self._defined or len(self.contents.chunks) == self._repeat_at:
            records = (*self.contents.schemas.values(), *self.contents.channels.values())
            copy = b"".join(map(record_bytes, records))
            front, indexed = attachment(DEFINITIONS, "application/octet-stream", 0, copy, self.size)
        index = {channel: b"".join(pairs) for channel, pairs in self._index.items()}
        body, chunk = chunk_bytes(b"".join(self._pieces), index, self.size + len(front), self._compressor)
        self._write(front + body)
        if indexed is not None:
            self.contents.attachments.append(indexed)
        self.contents.add_chunk(chunk, {channel: len(pairs) // _PAIR.size for channel, pairs in index.items()})
        self._begin()

    def finish(self) -> None:
        """Write the end of the file; it stays open and locked until ``publish``."""
        self.write_chunk()
        self._write(closing(self.contents, self.size))

    def publish(self) -> None:
        """Sync a finished file to disk and give it its final name."""
        os.fsync(self._file.fileno())
        self.part.rename(self.path)
        sync_folder(self.path.parent)
        self._file.close()

    def descriptor(self) -> int:
        """A second descriptor of the file, for another thread to sync and close."""
        return os.dup(self._file.fileno())

    def check_place(self) -> None:
        """Raise ``DisplacedError`` if the file is not where readers look for it."""
        check_place(self._file.fileno(), self.part)

    def leave(self) -> None:
        """Finish the file at its present path: whoever moved it gets a whole recording."""
        with contextlib.suppress(OSError):
            self.finish()
        self.release()

    def abandon(self) -> None:
        """Cut off an incomplete end and close the file; a file without a chunk is removed."""
        with contextlib.suppress(OSError):
            if self.contents.chunks:
                self._file.truncate(self.size)
            else:
                self.part.unlink(missing_ok=True)
        self.release()

    def discard(self) -> None:
        """Close the file and remove it, unless it has its final name."""
        self.release()
        with contextlib.suppress(OSError):
            self.part.unlink(missing_ok=True)

    def release(self) -> None:
        """Close the file as it is."""
        with contextlib.suppress(OSError):
            self._file.close()

    def _write(self, data: bytes) -> None:
        write_all(self._file, data)
        self.size += len(data)
