"""A table of named corruptions: what each leaves, and what is said about it."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader

from cellwatt import Batch, Event, Tick
from cellwatt.record import Recording, recover
from cellwatt.record.container import Chunk
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import PART
from cellwatt.record.openfile import OpenFile

from .making import CELL, HEADER, SESSION, batch_of, name_of, same_entry, write_chunks

CHUNKS = 80
PER_CHUNK = 4
"""Batches of 3, 1, 4 and 2 samples, and a tick."""


def entries_of(chunk: int) -> list[Batch | Tick]:
    sizes = {0: 3, 3: 1, 4: 4, 8: 2}
    return [*(batch_of(chunk * 10 + at, size) for at, size in sizes.items()), Tick(SESSION + chunk)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a file as a killed writer leaves it, of the same file closed, and where its chunks are."""
    folder, chunks = tmp_path_factory.mktemp("whole"), [entries_of(n) for n in range(CHUNKS)]
    file = write_chunks(folder, chunks, close=False)
    open_bytes = (folder / (name_of() + PART)).rename(folder / "left").read_bytes()
    write_chunks(folder, chunks)
    closed_bytes = (folder / name_of()).read_bytes()
    assert closed_bytes.startswith(open_bytes)
    return open_bytes, closed_bytes, file.contents.chunks


@pytest.fixture
def part(tmp_path):
    return tmp_path / (name_of() + PART)


Place = Callable[[list[Chunk]], int]


def flip(place: Place, mask: int = 0x10):
    def change(data: bytes, chunks: list[Chunk]) -> bytes:
        at = place(chunks)
        return data[:at] + bytes([data[at] ^ mask]) + data[at + 1 :]

    return change


def cut(place: Place):
    return lambda data, chunks: data[: place(chunks)]


def insert(place: Place, garbage: bytes):
    return lambda data, chunks: data[: place(chunks)] + garbage + data[place(chunks) :]


def zero(place: Place, length: int):
    return lambda data, chunks: data[: place(chunks)] + bytes(length) + data[place(chunks) + length :]


def chunk(number: int, offset: int = 0) -> Place:
    """A place in a chunk's record: 0 opcode, 1 length, 9 start, 17 end, 25 size, 33 crc, 37 name, 45 size, 53 data."""
    return lambda chunks: chunks[number].offset + offset


def index(number: int, offset: int = 0) -> Place:
    return lambda chunks: chunks[number].offset + chunks[number].length + offset


def end(number: int) -> Place:
    return lambda chunks: chunks[number].offset + chunks[number].length + chunks[number].index_length


GARBAGE = bytes(range(1, 250)) * 20
HEADER_RECORD, ATTACHMENT = 8, 8 + 9 + 4 + 4 + 8
LAST = CHUNKS - 1


@dataclass
class Case:
    """``lost`` chunks of the file; ``says`` must stand in the report; ``aside``: bytes are kept apart."""

    change: Callable[[bytes, list[Chunk]], bytes]
    lost: set[int] = field(default_factory=set)
    says: str = ""
    aside: bool = False
    closed: bool = False
    unknown_header: bool = False


CASES = {
    "killed between two chunks": Case(lambda d, c: d, says="nothing lost except data still in memory"),
    "torn in a chunk's data": Case(cut(chunk(LAST, 200)), {LAST}, "the file ends within a record", aside=True),
    "torn between a chunk and its index": Case(cut(index(LAST)), says="recovered"),
    "torn in a chunk's index": Case(cut(index(LAST, 40)), says="the index of a chunk is wrong", aside=True),
    "zero-filled tail": Case(lambda d, c: d + bytes(8192), says="8192 bytes unreadable"),
    "garbage in front of a chunk": Case(insert(chunk(7), GARBAGE), says="4980 bytes unreadable", aside=True),
    "garbage within a chunk": Case(insert(chunk(7, 90), GARBAGE), {7}, "10 of /raw/arm/rtde", aside=True),
    "bit flip in a chunk's opcode": Case(flip(chunk(7), 0x40), {7}, "not a record", aside=True),
    "bit flip in a chunk's length, high": Case(flip(chunk(7, 8), 0x80), {7}, "10 of", aside=True),
    "bit flip in a chunk's size, high": Case(flip(chunk(7, 32), 0x40), {7}, "length is wrong", aside=True),
    "bit flip in a chunk's checksum": Case(flip(chunk(7, 33)), {7}, "checksum is wrong", aside=True),
    "bit flip in a chunk's compression": Case(flip(chunk(7, 43)), {7}, "compressed with", aside=True),
    "bit flip in a chunk's data": Case(flip(chunk(7, 300)), {7}, "lost: 10 of /raw/arm/rtde, 1 of /tick", aside=True),
    "bit flip in an index's times": Case(flip(index(7, 18)), says="the index of a chunk is wrong", aside=True),
    "bad sector from an index into the next chunk": Case(zero(index(7, 20), 512), {8}, "10 of", aside=True),
    "magic missing": Case(lambda d, c: d[8:], says="does not begin like", aside=True, unknown_header=True),
    "header record flipped": Case(flip(lambda c: HEADER_RECORD + 1), aside=True, unknown_header=True),
    "origin flipped": Case(flip(lambda c: ATTACHMENT + 90), says="attachment", aside=True, unknown_header=True),
    "definitions flipped": Case(flip(lambda c: c[0].offset - 500), says="attachment's checksum", aside=True),
    "bad sector over both copies of the definitions": Case(
        zero(lambda c: c[0].offset - 500, 1000), {0}, "lost: 10 of /raw/arm/rtde, 1 of /tick", aside=True
    ),
    "killed before the rename": Case(lambda d, c: d, says="nothing lost", closed=True),
    "bit flip in the summary": Case(flip(lambda c: -300), says="the summary is damaged", aside=True, closed=True),
    "bit flip in the data's end": Case(flip(end(LAST)), says="unreadable", aside=True, closed=True),
    "bit flip in a chunk of a closed file": Case(flip(chunk(7, 300)), {7}, "10 of", aside=True, closed=True),
}


@pytest.mark.parametrize("name", CASES)
def test_a_file_left_open_is_recovered(name, whole, tmp_path, part):
    case = CASES[name]
    data = case.change(whole[1] if case.closed else whole[0], whole[2])
    part.write_bytes(data)
    expected = [e for n in range(CHUNKS) if n not in case.lost for e in entries_of(n)]

    report = recover(part)

    assert report is not None and report.result == tmp_path / name_of()
    assert case.says in str(report)
    assert not part.exists()
    assert report.messages == sum(len(e) if isinstance(e, Batch) else 1 for e in expected)
    assert (report.aside is not None) == case.aside
    if report.aside:
        assert report.aside.read_bytes() in data
    recording = Recording.open(tmp_path)
    back = list(recording.entries())
    assert len(back) == len(expected) and all(map(same_entry, back, expected))
    assert not recording.damage
    assert recording.header.cell == CELL and recording.header.session == SESSION
    assert (recording.header.site == "") == case.unknown_header
    check_with_the_library(tmp_path / name_of(), report.messages)


def check_with_the_library(path, messages):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert len(list(reader.iter_messages())) == messages == reader.get_summary().statistics.message_count
        assert list(reader.iter_attachments())
        for place in reader.get_summary().chunk_indexes:
            for channel, offset in place.message_index_offsets.items():
                file.seek(offset)
                opcode, _, found = struct.unpack("<BQH", file.read(11))
                assert (opcode, found) == (7, channel)


CLOSED = {n: c for n, c in CASES.items() if c.closed or "flip" in n}
TOLD_TWICE = {f"bit flip in a chunk's {what}" for what in ("opcode", "length, high")}
"""A closed file's summary says the same of each chunk, so that nothing is lost."""


@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_file_is_read_around_its_damage(name, whole, tmp_path):
    case = CLOSED[name]
    data = case.change(whole[1], whole[2])
    path = tmp_path / name_of()
    path.write_bytes(data)

    recording = Recording.open(path)
    back = list(recording.entries())

    lost = set() if name in TOLD_TWICE else case.lost
    expected = [e for n in range(CHUNKS) if n not in lost for e in entries_of(n)]
    assert len(back) == len(expected) and all(map(same_entry, back, expected))
    if lost:
        assert recording.damage and name_of() in str(recording.damage[0])
    assert path.read_bytes() == data


NOTHING = {
    "truncated to 0": b"",
    "only the magic": b"\x89MCAP0\r\n",
    "garbage": GARBAGE,
    "zeros": bytes(100_000),
}


@pytest.mark.parametrize("name", NOTHING)
def test_a_file_without_a_chunk_leaves_no_recording(name, tmp_path, part):
    part.write_bytes(NOTHING[name])
    report = recover(part)
    assert report is not None and report.result is None and report.messages == 0
    assert not part.exists() and not (tmp_path / name_of()).exists()
    readable = name in ("truncated to 0", "only the magic")
    assert (report.aside is None) == readable
    assert ("held no message" in str(report)) == (name != "truncated to 0")
    if report.aside:
        assert report.aside.read_bytes() == NOTHING[name]


def test_a_message_that_is_none_costs_its_chunk_no_samples(tmp_path, part):
    event = Event(SESSION, "arm", "connected", "UR10e")
    broken = OpenFile(tmp_path / name_of(), HEADER)
    encoder = Encoder(broken)
    encoder.add(batch_of(0, 5))
    encoder.add(event)
    broken.add_message(2, 1, SESSION, b"{}")
    broken.write_chunk()
    encoder.add(batch_of(5, 5))
    broken.write_chunk()
    broken.release()
    data = part.read_bytes()
    at = broken.contents.chunks[1].offset
    part.write_bytes(data[:at] + GARBAGE + data[at:])
    report = recover(part)
    assert report is not None and report.result is not None and report.messages == 10
    assert dict(report.missing) == {"/event": 2}
    back = Recording.open(report.result)
    assert all(map(same_entry, back.entries(), [batch_of(0, 5), batch_of(5, 5)]))
    assert back.counts == {"/raw/arm/rtde": 10}


def test_a_copy_beside_the_closed_file_is_set_aside(whole, tmp_path, part):
    (tmp_path / name_of()).write_bytes(whole[1])
    part.write_bytes(whole[0])
    report = recover(part)
    assert report is not None and "exists already" in str(report)
    assert (tmp_path / name_of()).read_bytes() == whole[1]
    assert (tmp_path / (name_of() + ".part.damaged")).read_bytes() == whole[0]
    part.write_bytes(b"another")
    assert "moved to" in str(recover(part))
    assert (tmp_path / (name_of() + ".part.damaged")).read_bytes() == whole[0], "nothing is written over"
    assert (tmp_path / (name_of() + ".part.2.damaged")).read_bytes() == b"another"


def test_a_duplicate_is_read_once_and_the_fuller_one_wins(whole, tmp_path):
    (tmp_path / "copy.mcap").write_bytes(whole[1])
    (tmp_path / name_of()).write_bytes(whole[0][: whole[2][5].offset])
    recording = Recording.open(tmp_path)
    assert len(list(recording.entries())) == CHUNKS * (PER_CHUNK + 1)
    assert f"{name_of()}: is a copy of copy.mcap, not read again" in map(str, recording.damage)


def test_chunks_whose_channels_nothing_describes_are_kept_aside(tmp_path, part):
    file = write_chunks(tmp_path, map(entries_of, range(3)), close=False)
    data = zero(lambda c: c[0].offset - 500, 1000)(part.read_bytes(), file.contents.chunks)
    part.write_bytes(data)
    report = recover(part)
    assert report is not None and report.result is None
    assert "the definitions of its channels are lost" in str(report)
    assert report.aside is not None and report.aside.read_bytes() == data


def test_an_unreadable_file_beside_good_ones_is_damage_not_an_error(whole, tmp_path):
    (tmp_path / name_of(1)).write_bytes(whole[1])
    (tmp_path / name_of(2)).write_bytes(b"nothing")
    recording = Recording.open(tmp_path)
    assert [str(d) for d in recording.damage] == [
        f"{name_of(2)}: 7 bytes at 0 cannot be read: it holds no readable data"
    ]


@settings(deadline=None, max_examples=40)
@given(
    st.booleans(),
    st.lists(
        st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 3), st.binary(min_size=1, max_size=40)), max_size=5
    ),
)
def test_whatever_happens_what_is_left_is_true(whole, tmp_path_factory, closed, changes):
    """Random flips, insertions, deletions and truncations: never an error, never a wrong sample, never bytes gone."""
    data = whole[1] if closed else whole[0]
    for where, how, noise in changes:
        at = int(where * len(data))
        if how == 0:
            data = data[:at] + noise + data[at + len(noise) :]
        elif how == 1:
            data = data[:at] + noise + data[at:]
        elif how == 2:
            data = data[:at] + data[at + len(noise) :]
        else:
            data = data[:at]
    folder = tmp_path_factory.mktemp("fuzz")
    part = folder / (name_of() + PART)
    part.write_bytes(data)
    report = recover(part)
    assert report is not None and not report.problem and not part.exists()
    if report.result is None:
        return
    truth = {e.sequence: e for n in range(CHUNKS) for e in entries_of(n) if isinstance(e, Batch)}
    back = [e for e in Recording.open(report.result).entries() if isinstance(e, Batch)]
    assert all(same_entry(e, truth[e.sequence]) for e in back)
    assert [e.sequence for e in back] == sorted({e.sequence for e in back})
