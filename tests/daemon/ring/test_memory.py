"""A ring that is written over: what a reader gets is whole, in order, and what it does not get is told."""

import os
import signal
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.ring.memory import Ring

pytestmark = pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")

KIND, CHANNEL = 7, 3


@pytest.fixture
def ring():
    return Ring(4096, readers=2)


def put(ring, n, size=40):
    sequence = ring.following(CHANNEL)
    for i in range(sequence, sequence + n):
        ring.put(KIND, CHANNEL, i, 1, body_of(i, size))


def body_of(number, size):
    return number.to_bytes(8, "little") * (size // 8)


def read_all(ring, position):
    """Records from ``position`` on, bytes skipped, and where the next one begins."""
    found, skipped = [], 0
    while True:
        record, following = ring.read(position)
        if record is not None:
            found.append(record)
        elif following > position:
            skipped += following - position
        else:
            return found, skipped, position
        position = following


def test_a_record_that_does_not_fit_is_refused(ring):
    with pytest.raises(ValueError, match="does not fit"):
        ring.put(KIND, CHANNEL, 0, 1, bytes(ring.largest + 1))
    ring.put(KIND, CHANNEL, 0, 1, bytes(ring.largest))
    assert len(read_all(ring, 0)[0]) == 1


def test_no_more_is_written_over_than_must_be(ring):
    """Records of 128 bytes with their heads: 32 fill the ring to its end, and each one more costs one."""
    put(ring, 33, size=80)
    assert ring.head == 33 * 128
    found, skipped, _ = read_all(ring, 0)
    assert [r.sequence for r in found] == list(range(1, 33))
    assert skipped == 128


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 120)), max_size=30), st.data())
def test_nothing_is_read_twice_torn_or_lost_untold(steps, data):
    ring = Ring(4096, readers=1)
    position, expected, last = 0, {}, -1
    for n, size in steps:
        first = ring.following(CHANNEL)
        put(ring, n, size)
        expected |= {i: body_of(i, size) for i in range(first, first + n)}
        if data.draw(st.booleans()):
            found, skipped, position = read_all(ring, position)
            numbers = [r.sequence for r in found]
            assert all(r.body == expected[r.sequence] for r in found)
            if numbers:
                assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
                assert (numbers[0] == last + 1) == (skipped == 0)
                assert numbers[-1] == ring.following(CHANNEL) - 1
                last = numbers[-1]
    assert ring.head - ring.tail <= ring.size


def test_a_writer_that_is_killed_leaves_no_half_record_and_no_number_twice(ring, monkeypatch):
    put(ring, 3)

    class Killed(BaseException):
        pass

    def dies(self, length):
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(Ring, "_make_room", dies)
        with pytest.raises(Killed):
            put(ring, 1)
    put(ring, 2)  # the next writer
    assert [r.sequence for r in read_all(ring, 0)[0]] == [0, 1, 2, 3, 4]


def test_a_reader_that_looks_while_a_record_is_put_at_the_beginning_again_loses_nothing(ring, monkeypatch):
    put(ring, ring.size // 64 - 1, size=32)
    _, _, end = read_all(ring, 0)
    seen = []
    check = zlib.crc32

    def looked(body):
        seen.append(ring.read(end))
        return check(body)

    monkeypatch.setattr("cellwatt.ring.memory.zlib.crc32", looked)
    put(ring, 1, size=80)
    assert seen[0] == (None, end), "neither a record, nor one that was written over"
    monkeypatch.undo()
    found, skipped, _ = read_all(ring, end)
    assert (len(found), skipped) == (1, 0)


def test_damage_is_told_as_skipped(ring):
    put(ring, 3)
    ring._data[40] ^= 1
    found, skipped, _ = read_all(ring, 0)
    assert (found, skipped) == ([], ring.head)
    put(ring, 1)
    assert [r.sequence for r in read_all(ring, skipped)[0]] == [3]


def test_positions_and_declarations_last(ring):
    ring.settle(1, 64)
    ring.declare(b"one")
    lines, after = ring.declared()
    ring.declare(b"two")
    assert (ring.position(0), ring.position(1)) == (0, 64)
    assert lines == [b"one"]
    assert ring.declared(after)[0] == [b"two"]


def test_the_bell_rings_for_each_reader_and_at_the_end(ring):
    for ringing in (lambda: put(ring, 1), ring.end):
        ringing()
        for reader in (0, 1):
            assert os.eventfd_read(ring.bell(reader)) == 1
            ring.quiet(reader)
    assert ring.ended


def test_another_process_writes_while_this_one_reads():
    """Every record that a slow reader gets is whole, whatever the writer overwrites meanwhile."""
    ring = Ring(16384, readers=1)
    child = os.fork()
    if not child:
        try:
            for i in range(40_000):
                ring.put(KIND, CHANNEL, i, 1, body_of(i, 64 + 8 * (i % 50)))
            ring.end()
        finally:
            os._exit(0)
    try:
        position, last, got, skips = 0, -1, 0, 0
        while not (ring.ended and position == ring.head):
            record, following = ring.read(position)
            if record is None:
                skips += following > position
            else:
                assert record.body == body_of(record.sequence, 64 + 8 * (record.sequence % 50))
                assert record.sequence > last
                assert record.sequence == last + 1 or skips
                last, got = record.sequence, got + 1
            position = following
        assert last == 39_999
        assert got > 0
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def test_only_readers_that_listen_are_rung(ring):
    ring.listen(0, False)
    put(ring, 2)
    with pytest.raises(BlockingIOError):
        os.eventfd_read(ring.bell(0))
    assert os.eventfd_read(ring.bell(1)) == 2
    ring.listen(0)
    put(ring, 1)
    assert os.eventfd_read(ring.bell(0)) == 1


def test_a_ring_that_nobody_has_any_more_leaves_no_descriptor_open():
    ring = Ring(4096, readers=2)
    bell = ring.bell(1)
    os.fstat(bell)
    del ring
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(bell)
