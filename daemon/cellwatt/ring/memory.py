"""Records in shared memory: one process writes, several read, the oldest are overwritten.

The memory has no file and no name; forked processes share it, and it lasts as long as one of them. The writer never
waits. A reader that falls behind by more than the ring holds learns how many bytes it lost and continues with the
oldest record that is still whole.

Layout: first native 64-bit words: number of bytes ever written (*head*), position of the oldest byte still whole
(*tail*), 1 once the writer has ended, length of the declarations, a note of the writer, 1 while a consumer awaits the
records; then the settled position of each reader, the next sequence number of each channel, and 1 for each reader
that polls instead of listening. Declarations follow, to which lines are only appended, then the records, each with a
header of 32 bytes and a length that is a multiple of 32. A record becomes visible when *head* moves past it, so a
writer that is killed leaves no half record. A record that was overwritten while it was copied is detected by *tail*,
and by its checksum on machines that reorder stores.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
import weakref
import zlib
from typing import Final, NamedTuple

READERS: Final = 32
CHANNELS: Final = 1 << 16
"""Most channels; each new layout of rows takes one. Only used pages take memory."""
DECLARATIONS: Final = 16 << 20
"""Bytes reserved for declarations of channels."""

_HEAD, _TAIL, _ENDED, _DECLARED, _NOTE, _AWAITED, _POSITIONS = 0, 1, 2, 3, 4, 5, 8
_COUNTS = _POSITIONS + READERS
_DEAF = _COUNTS + CHANNELS
_WORDS = _DEAF + READERS
_START = -(-_WORDS * 8 // mmap.PAGESIZE) * mmap.PAGESIZE
_RECORD = struct.Struct("=IIHHIqq")
"""Length with this head, checksum of the body, kind, channel, length of the body, sequence number, spare."""
_STEP: Final = _RECORD.size
_PADDING: Final = 0


class Record(NamedTuple):
    """One record: its ``kind``, its channel and its number within the channel."""

    kind: int
    channel: int
    sequence: int
    body: bytes


class Ring:
    """``size`` bytes of records for ``readers`` readers; created before the processes that use it are forked."""

    def __init__(self, size: int, readers: int) -> None:
        if not 0 < readers <= READERS:
            raise ValueError(f"a ring has 1 to {READERS} readers, not {readers}")
        self.size = -(-size // mmap.PAGESIZE) * mmap.PAGESIZE
        self._memory = mmap.mmap(-1, _START + DECLARATIONS + self.size, mmap.MAP_SHARED | mmap.MAP_ANONYMOUS)
        view = memoryview(self._memory)
        # Stores to a view of 64-bit words are single stores; struct writes byte by byte.
        self._words = view[:_START].cast("Q")
        self._declarations = view[_START : _START + DECLARATIONS]
        self._data = view[_START + DECLARATIONS :]
        self._bells = tuple(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC) for _ in range(readers))
        weakref.finalize(self, _close, self._bells)

    @property
    def largest(self) -> int:
        """Largest length of a record's body in bytes."""
        return self.size // 4 - _STEP

    # writer ---------------------------------------------------------------------------------------

    def put(
        self,
        kind: int,
        channel: int,
        sequence: int,
        count: int,
        body: bytes,
        note: int | None = None,
        silent: bool = False,
    ) -> None:
        """Add a record of ``count`` items of its channel, numbered from ``sequence``; unless ``silent``, wake
        the listening readers.

        ``note`` is for the next writer. Raises ``ValueError`` if the body is longer than ``largest``.
        """
        if len(body) > self.largest:
            raise ValueError(f"a record of {len(body)} bytes does not fit a ring that takes {self.largest}")
        words, data = self._words, self._data
        length = -(-(len(body) + _STEP) // _STEP) * _STEP
        head = words[_HEAD]
        at = head % self.size
        padding = self.size - at if at + length > self.size else 0
        self._make_room(padding + length)
        if padding:
            _RECORD.pack_into(data, at, padding, 0, _PADDING, 0, 0, 0, 0)
            at = 0
        _RECORD.pack_into(data, at, length, zlib.crc32(body), kind, channel, len(body), sequence, 0)
        data[at + _STEP : at + _STEP + len(body)] = body
        # In this order a kill in between leaves a gap in the numbers, not a number used twice.
        words[_COUNTS + channel] = sequence + count
        if note is not None:
            words[_NOTE] = note
        words[_HEAD] = head + padding + length  # in one step: padding without a record would look overwritten
        if not silent:
            self._ring()

    def following(self, channel: int) -> int:
        """Next sequence number of a channel, whichever process wrote the last one."""
        return self._words[_COUNTS + channel]

    @property
    def note(self) -> int:
        """The last note of the writer, 0 before the first."""
        return self._words[_NOTE]

    def declare(self, line: bytes) -> None:
        """Add a line that describes a channel, for present and future readers."""
        end = self._words[_DECLARED]
        if end + len(line) + 1 > DECLARATIONS:
            raise ValueError("the settings were changed too often for one run of the daemon: restart it")
        self._declarations[end : end + len(line) + 1] = line + b"\n"
        self._words[_DECLARED] = end + len(line) + 1

    def end(self) -> None:
        """Declare that no more records will come until ``begin``."""
        self._words[_ENDED] = 1
        self._ring()

    def begin(self) -> None:
        """Declare that another writer will follow the one that ended."""
        self._words[_ENDED] = 0

    def _make_room(self, length: int) -> None:
        words = self._words
        tail, needed = words[_TAIL], words[_HEAD] + length - self.size
        if tail < needed:
            while tail < needed:
                tail += _RECORD.unpack_from(self._data, tail % self.size)[0]
            words[_TAIL] = tail

    def _ring(self) -> None:
        words = self._words
        for reader, bell in enumerate(self._bells, _DEAF):
            if not words[reader]:
                os.eventfd_write(bell, 1)

    # readers --------------------------------------------------------------------------------------

    def bell(self, reader: int) -> int:
        """A descriptor that becomes readable when there is a new record; ``quiet`` resets it."""
        return self._bells[reader]

    def listen(self, reader: int, wanted: bool = True) -> None:
        """Have ``bell`` rung at each record (the default), or not; check for records after this call, not before.

        A record put at the same moment may ring the bell only with the next one.
        """
        self._words[_DEAF + reader] = not wanted

    def quiet(self, reader: int) -> None:
        """Reset ``bell``; check for records after this call, not before."""
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._bells[reader])

    @property
    def head(self) -> int:
        """Bytes ever written."""
        return self._words[_HEAD]

    @property
    def tail(self) -> int:
        """Position of the oldest record still whole."""
        return self._words[_TAIL]

    @property
    def ended(self) -> bool:
        """True if no more records will come."""
        return bool(self._words[_ENDED])

    def read(self, position: int) -> tuple[Record | None, int]:
        """The record at ``position`` and the position of the next one.

        ``None`` with the same position: no record yet. ``None`` with a later position: the record was overwritten.
        """
        while True:
            if position < self.tail:
                return None, self.tail
            if position >= self.head:
                return None, position
            at = position % self.size
            length, check, kind, channel, size, sequence, _ = _RECORD.unpack_from(self._data, at)
            body = bytes(self._data[at + _STEP : at + _STEP + size])
            if position < self.tail:
                return None, self.tail
            if kind != _PADDING:
                if zlib.crc32(body) != check:
                    return None, self.head
                return Record(kind, channel, sequence, body), position + length
            position += length

    @property
    def awaited(self) -> bool:
        """True while a consumer awaits the records: set by a reader, read by the writer."""
        return bool(self._words[_AWAITED])

    @awaited.setter
    def awaited(self, awaited: bool) -> None:
        self._words[_AWAITED] = awaited

    def position(self, reader: int) -> int:
        """Settled position of a reader."""
        return self._words[_POSITIONS + reader]

    def crowded(self, reader: int) -> bool:
        """True if the records that a reader has not settled fill more than half of the ring."""
        return 2 * (self._words[_HEAD] - self._words[_POSITIONS + reader]) > self.size

    def settle(self, reader: int, position: int) -> None:
        """Mark everything before ``position`` as done: a successor of this reader continues there."""
        self._words[_POSITIONS + reader] = position

    def declared(self, after: int = 0) -> tuple[list[bytes], int]:
        """Lines declared after byte ``after``, and the present length of the declarations in bytes."""
        end = self._words[_DECLARED]
        return bytes(self._declarations[after:end]).splitlines(), end


def _close(descriptors: tuple[int, ...]) -> None:
    for descriptor in descriptors:
        os.close(descriptor)
