"""Recordings that were made to fill the memory, or to hang or break who reads them."""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import pytest
import zstandard
from mcap.opcode import Opcode

from cellwatt import RecordingError
from cellwatt.record import Recording, recover
from cellwatt.record.chunks import LARGEST_CHUNK, open_chunk
from cellwatt.record.container import (
    CHUNK_HEAD,
    COMPRESSION,
    Chunk,
    closing,
    framed,
)
from cellwatt.record.header import PART
from tests.patience import PATIENCE

from .making import batch_of, name_of, write_chunks

MIB = 1 << 20
ROOM = 250 * MIB
"""What reading may add to the memory; a whole chunk of the largest size, unpacked and listed, is in it."""

READ = """
import resource, sys
from pathlib import Path
from cellwatt import RecordingError
from cellwatt.record import Recording, recover
path = Path(sys.argv[1])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    if path.suffix == ".part":
        told = str(recover(path))
    else:
        recording = Recording.open(path)
        kept = sum(len(item) for item in recording.entries() if hasattr(item, "sequence"))
        told = f"{kept} samples; " + "; ".join(map(str, recording.damage))
except RecordingError as error:
    told = str(error)
print(1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before))
print(told)
"""


def read_elsewhere(path: Path) -> tuple[int, str]:
    """Bytes that reading a file in a process of its own adds to its memory at most, and what it says."""
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    grown, told = done.stdout.split("\n", 1)
    return int(grown), told.strip()


def bomb(size: int) -> bytes:
    """A chunk that is sound, but unpacks to ``size`` bytes of one foreign record."""
    compressor = zstandard.ZstdCompressor(level=3).compressobj(size=size)
    head = struct.pack("<BQ", Opcode.METADATA, size - 9)
    packed, crc, left = bytearray(compressor.compress(head)), zlib.crc32(head), size - len(head)
    zeros = bytes(MIB)
    while left:
        piece = zeros[: min(left, MIB)]
        packed += compressor.compress(piece)
        crc = zlib.crc32(piece, crc)
        left -= len(piece)
    packed += compressor.flush()
    body = CHUNK_HEAD.pack(0, 0, size, crc) + COMPRESSION + struct.pack("<Q", len(packed)) + packed
    return framed(Opcode.CHUNK, body)


@pytest.fixture(scope="module")
def large_bomb() -> bytes:
    return bomb(900 * MIB)


@pytest.mark.parametrize("ending", ["summary", "left open"])
def test_a_chunk_that_unpacks_to_900_mib(tmp_path: Path, large_bomb: bytes, ending: str) -> None:
    file = write_chunks(tmp_path, [[batch_of(0, 20)]], close=False)
    path = tmp_path / (name_of() + (PART if ending == "left open" else ""))
    data = (tmp_path / (name_of() + PART)).read_bytes()
    at = len(data)
    file.contents.add_chunk(Chunk(at, len(large_bomb), 0, 0, 0, 900 * MIB, ((1, 0),), 0), {1: 1})
    end = closing(file.contents, at + len(large_bomb)) if ending == "summary" else b""
    path.write_bytes(data + large_bomb + end)
    assert path.stat().st_size < 40_000

    grown, told = read_elsewhere(path)

    assert grown < ROOM
    assert "a chunk's length is wrong" in told
    assert told.startswith("20 samples; " if ending == "summary" else f"{name_of()}: 20 messages recovered")


def test_the_largest_chunk_is_read(tmp_path: Path) -> None:
    opened = open_chunk(bomb(LARGEST_CHUNK)[9:])
    assert len(opened.data) == LARGEST_CHUNK
    with pytest.raises(ValueError, match="a chunk's length is wrong"):
        open_chunk(bomb(LARGEST_CHUNK + 1)[9:])


@pytest.mark.parametrize("summary", ["of two gigabytes", "that names places beyond all files"])
def test_a_summary(tmp_path: Path, summary: str) -> None:
    file = write_chunks(tmp_path, [[batch_of(0, 20)]], close=False)
    path = (tmp_path / (name_of() + PART)).rename(tmp_path / name_of())
    places = ((1 << 63, 10), (5, 1 << 62), (0, 0)) if "names" in summary else ()
    for offset, length in places:
        file.contents.add_chunk(Chunk(offset, length, 0, 0, 0, 0, ((1, 0),), 0), {})
    end = closing(file.contents, file.size)
    with path.open("ab") as out:
        out.write(end if places else end[:-37])
        if not places:
            out.truncate(1 << 31)
            out.write(framed(Opcode.FOOTER, struct.pack("<QQI", 100, 0, 0)) + end[-8:])
    grown, told = read_elsewhere(path)
    assert grown < ROOM
    assert told.startswith("20 samples; ")


@pytest.mark.timeout(60)
def test_a_fifo_among_recordings(tmp_path: Path) -> None:
    write_chunks(tmp_path, [[batch_of(0, 20)]])
    os.mkfifo(tmp_path / name_of(2))
    os.mkfifo(tmp_path / (name_of(3) + PART))
    recording = Recording.open(tmp_path)
    assert sum(len(item) for item in recording.entries()) == 20
    assert len(recording.damage) == 2
    with pytest.raises(RecordingError, match="a FIFO, expected a file"):
        Recording.open(tmp_path / name_of(2))
    recovered = recover(tmp_path / (name_of(3) + PART))
    assert recovered is not None
    assert "a FIFO, expected a file" in str(recovered)
    assert (tmp_path / (name_of(3) + PART)).exists()
