"""A recording's file: summary, chunks, index, recovery."""

from __future__ import annotations

import struct
import tempfile
import zlib
from collections.abc import Iterable
from contextlib import suppress
from io import FileIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mcap.opcode import Opcode

from cellwatt.errors import RecordingError
from cellwatt.record import Recording, recover
from cellwatt.record.container import CHUNK_HEAD, MAGIC, RECORD
from cellwatt.record.encoder import Encoder, Item
from cellwatt.record.header import PART, FileName, Header
from cellwatt.record.history import History
from cellwatt.record.openfile import OpenFile
from cellwatt.record.scan import scan
from fuzz.items import MESSAGES, SESSION, batch, frames
from fuzz.target import Target, folder

CELL = "c"
NAME = str(FileName(SESSION, 1, CELL))


def run(data: bytes) -> None:
    """The first byte says what is done, and whether checksums are mended first, so that what is behind them is reached.

    0 reads, 1 asks as for a running daemon, 2 recovers; 4 more mends.
    """
    how = data[0] if data else 0
    content = mended(data[1:]) if how & 4 else data[1:]
    with tempfile.TemporaryDirectory(dir=folder()) as name:
        path = Path(name) / NAME
        if how & 3 > 1:
            path = path.with_name(NAME + PART)
        path.write_bytes(content)
        (_read, _ask, _recover, _recover)[how & 3](path)


def _read(path: Path) -> None:
    try:
        recording = Recording.open(path)
    except RecordingError:
        return
    assert all("\n" not in str(damage) for damage in recording.damage)
    list(recording.entries())
    list(recording.frames())
    list(recording.results())
    list(recording.events())
    list(recording.health())
    assert isinstance(recording.counts, dict)
    with suppress(RecordingError):
        recording.frames_table()
    for source, streams in recording.streams.items():
        for stream in streams:
            with suppress(RecordingError):  # channels that change
                samples = recording.batches(source, stream.name)
                assert samples.values.shape == (len(samples), len(samples.stream.channels))


def _ask(path: Path) -> None:
    """As a running daemon answers from its folder."""
    recorder: Any = SimpleNamespace(
        cell=CELL,
        live=lambda: None,
        flush=lambda timeout: False,
        upkeep=SimpleNamespace(repairing=lambda session: False),
    )
    history = History(path.parent, recorder)
    assert len(history.recordings()) == 1
    for first in (0, 3):
        for found in history.history("arm", "rtde", SESSION, first, 5):
            assert first <= found.sequence < first + 5


def _recover(part: Path) -> None:
    """What recovery makes is whole, and it says how much that is."""
    told = recover(part)
    assert told is not None
    assert not told.problem, told.problem
    assert not part.exists()
    if told.result is None:
        return
    with FileIO(told.result, "rb") as file:
        found = scan(file, told.result)
    assert found.closed
    assert not found.damage, found.damage
    assert found.contents.counts.total() == told.messages
    _read(told.result)


def mended(data: bytes) -> bytes:
    """The records with right checksums, as far as they can be followed; the summary's is left out."""
    out, at = bytearray(data), len(MAGIC)
    while at + RECORD.size <= len(out):
        opcode, length = RECORD.unpack_from(out, at)
        start, end = at + RECORD.size, at + RECORD.size + length
        if end > len(out):
            break
        if opcode == Opcode.CHUNK and length >= CHUNK_HEAD.size + 12:
            _mend_chunk(out, start, end)
        elif opcode == Opcode.ATTACHMENT and length >= 4:
            struct.pack_into("<I", out, end - 4, zlib.crc32(out[start : end - 4]))
        elif opcode == Opcode.FOOTER and length == 20:
            struct.pack_into("<I", out, end - 4, 0)
        at = end
    return bytes(out)


def _mend_chunk(out: bytearray, start: int, end: int) -> None:
    """Only of chunks without compression."""
    at = start + CHUNK_HEAD.size
    if out[at : at + 4] == bytes(4):
        records = out[at + 12 : end]
        struct.pack_into("<QI", out, start + 16, len(records), zlib.crc32(records))
        struct.pack_into("<Q", out, at + 4, len(records))


def recorded(chunks: Iterable[Iterable[Item]], *, plain: bool, close: bool) -> bytes:
    """A file as it is written; ``plain`` without compression."""
    with tempfile.TemporaryDirectory(dir=folder()) as name:
        path = Path(name) / NAME
        file = OpenFile(path, Header("plant", CELL, SESSION, number=1))
        if plain:
            file._compressor = SimpleNamespace(compress=bytes)  # type: ignore[assignment]
        encoder = Encoder(file)
        for items in chunks:
            for item in items:
                encoder.add(item)
            file.write_chunk()
        if close:
            file.finish()
        content = file.part.read_bytes()
        file.release()
    return _uncompressed(content) if plain else content


def _uncompressed(data: bytes) -> bytes:
    """Chunks that say that they are not compressed; what points behind them is wrong then, as in a damaged file."""
    out, at = bytearray(data[: len(MAGIC)]), len(MAGIC)
    while at + RECORD.size <= len(data):
        opcode, length = RECORD.unpack_from(data, at)
        body = data[at + RECORD.size : at + RECORD.size + length]
        if opcode == Opcode.CHUNK:
            body = body[: CHUNK_HEAD.size] + bytes(4) + body[CHUNK_HEAD.size + 8 :]
        out += RECORD.pack(opcode, len(body)) + body
        at += RECORD.size + length
    return bytes(out) + data[at:]


def seeds() -> Iterable[bytes]:
    """Files with few items, closed and left open, with and without compression."""
    few: list[list[Item]] = [[batch(0, 2), batch(2, 3)], [batch(5, 1)]]
    short = recorded([[batch(0, 1)]], plain=True, close=False)
    for how in (4, 5, 6):
        yield bytes([how]) + short
    yield b"\4" + recorded(few, plain=True, close=True)
    yield b"\4" + recorded([[frames(0, 2)]], plain=True, close=False)
    yield b"\1" + recorded(few, plain=False, close=True)
    yield b"\2" + recorded([[MESSAGES[0]], [MESSAGES[0]]], plain=False, close=False)


TARGET = Target(run, seeds, 6000)
