"""Items on their way through a ring: what comes out is what was put in, also where the writer changed meanwhile."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest

from cellwatt.batch import Tick
from cellwatt.frames import Frames, cut, join
from cellwatt.record.rows import SampleRows
from cellwatt.results import Alarm, Event, Prediction
from cellwatt.ring import ItemReader, ItemWriter, Mark, Ring, RingJournal, Status
from tests.blocks import same_frames
from tests.daemon.record.making import ARM, batch_of, same_entry
from tests.daemon.runtime.fakes import alarm, frames_of, prediction


@pytest.fixture
def ring():
    return Ring(1 << 16, readers=2)


def test_every_kind_of_item_comes_through(ring):
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    event = Event(5, "arm", "lost", "arm: nobody answers", {"after_s": 3.0})
    items = [batch_of(0, 3), Tick(7), frames_of(0, 4), event, alarm(), prediction("m", 1), Mark(2), Status({"a": 1})]
    for item in items:
        writer.put(item)
    got = list(reader.items())
    for put, found in zip(items, got, strict=True):
        assert same_frames(put, found) if isinstance(put, Frames) else same_entry(put, found)
    assert list(reader.items()) == []


def test_figures_of_a_driver_of_any_author_come_through(ring):
    """One that counts with numpy must not end the process that reads all devices."""
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    writer.put(Status({"missed": {"gap": np.int64(3)}, "serial": b"7", "rates": np.array([1.5])}))
    assert list(reader.items()) == [Status({"missed": {"gap": 3}, "serial": "b'7'", "rates": [1.5]})]


def test_samples_are_recorded_as_they_stand_in_the_ring(ring):
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    put = batch_of(7, 4)
    writer.put(put)
    (got,) = reader.items()
    rows = SampleRows(put.source, put.stream)
    assert rows.encode(got, 300).tobytes() == rows.encode(put, 300).tobytes()
    assert got.rows is not None and (got.rows["channel"] != 300).all(), "a copy is moved, not the rows"
    part = cut(got, 1, 3)
    assert part.rows is None
    assert rows.encode(part, 3).tobytes() == rows.encode(cut(put, 1, 3), 3).tobytes()
    assert replace(got, values=got.values + 1).rows is None


def test_a_block_that_is_too_large_goes_in_parts(ring):
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    large = batch_of(0, 350)
    assert len(large) * 100 > ring.largest
    writer.put(large)
    parts = list(reader.items())
    assert len(parts) > 1
    assert [p.sequence for p in parts] == list(np.cumsum([0, *map(len, parts)])[:-1])
    assert same_entry(join(parts, len(large)), large)


def test_a_writer_that_follows_another_numbers_on_and_knows_its_streams(ring):
    reader = ItemReader(ring, 0)
    first = ItemWriter(ring)
    first.put(batch_of(0, 5))
    first.put(frames_of(0, 3))
    second = ItemWriter(ring)
    batch = batch_of(0, 1)
    assert second.numbers() == {batch.source: {batch.stream.name: 5}}
    assert second.frames() == (3, int(frames_of(0, 3).time[-1]))
    second.put(batch_of(5, 2))
    assert len(ring.declared()[0]) == 2, "declared once"
    assert [i.sequence for i in reader.items()] == [0, 0, 5]


def test_a_reader_that_follows_another_goes_on_where_that_one_had_settled(ring):
    writer, first = ItemWriter(ring), ItemReader(ring, 1)
    for n in range(10):
        writer.put(batch_of(n, 1))
    for item in first.items():
        if item.sequence == 6:
            break
        first.settle()
    assert [i.sequence for i in ItemReader(ring, 1).items()] == [6, 7, 8, 9]


def test_a_stream_that_changes_is_another_channel(ring):
    """However often settings change in one run of the daemon: readers are rung still."""
    writer, reader, batch = ItemWriter(ring), ItemReader(ring, 0), batch_of(0, 1)
    reader.listen()
    for rate in range(1, 5001):
        writer.put(replace(batch, stream=replace(ARM, rate=float(rate))))
        assert os.eventfd_read(reader.bell) == 1
        assert [i.stream.rate for i in reader.items()] == [rate]


def test_a_reader_that_a_writer_outruns_comes_to_an_end(ring):
    """A device that sends faster than this process reads must not keep it from everything else."""
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    writer.put(Tick(0))
    seen = 0
    for _ in reader.items():
        writer.put(Tick(seen + 1))
        seen += 1
        assert seen < 10
    assert seen == 1
    assert len(list(reader.items())) == 1


def test_what_a_slow_reader_missed_is_told(ring):
    writer, reader = ItemWriter(ring), ItemReader(ring, 0)
    for n in range(3000):
        writer.put(batch_of(n, 1))
    got = list(reader.items())
    assert reader.skipped > 0
    numbers = [i.sequence for i in got]
    assert numbers == list(range(3000 - len(numbers), 3000))


def test_a_journal_numbers_each_series_and_gives_the_last_of_it_back():
    rings = Ring(1 << 16, 1), Ring(1 << 16, 1)
    journal = RingJournal(*rings)
    numbers = [journal.put(item) for item in (alarm("a"), prediction("m", 1), alarm("a", active=False))]
    assert numbers == [0, 0, 1]
    for n in range(5000):
        assert journal.put(prediction("m", n)) == n + 1
    past = list(RingJournal(*rings).past())
    assert [(n, a.active) for n, a in past if isinstance(a, Alarm)] == [(0, True), (1, False)]
    predictions = [(n, p.sequence) for n, p in past if isinstance(p, Prediction)]
    assert predictions[-1] == (5000, 4999)
    following = RingJournal(*rings)
    assert following.put(prediction("m", 0)) == 5001
    # Consumers follow each model for itself: to them a number that another one has is a message that is missing.
    assert [following.put(prediction(m, 0)) for m in ("other", "m", "other")] == [0, 5002, 1]
    assert RingJournal(*rings).put(prediction("other", 0)) == 2
