"""What one source may bring: an honest device loses nothing, a flood is cut, counted and told."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np
import pytest

from cellwatt import Batch, Channel, Event, Reading, Stream
from cellwatt.frames import Layout
from cellwatt.ring import ItemReader, ItemWriter
from cellwatt.runtime.allowance import BACKLOG, LONGEST, MOST, MULTIPLE, Allowance, Repeats, one_line
from cellwatt.runtime.processes.shared import TELL, Shared
from cellwatt.runtime.source import Source
from cellwatt.runtime.troubles import Monitor

SECOND = 10**9
RATE = 500.0


def never() -> bool:
    return False


class Time:
    """A clock that the test sets, ns."""

    def __init__(self) -> None:
        self.now = 1_790_000_000 * SECOND

    def __call__(self) -> int:
        return self.now


def test_a_device_may_run_faster_than_it_declares_for_hours() -> None:
    time = Time()
    allowance = Allowance(RATE, time, never)
    for _ in range(2 * 3600):
        time.now += SECOND
        assert allowance.take(round(2 * RATE)) == round(2 * RATE)


@pytest.mark.parametrize("stall", [1, 29])
def test_what_waited_while_the_network_stood_still_comes_at_once(stall: int) -> None:
    time = Time()
    allowance = Allowance(RATE, time, never)
    for _ in range(50):
        for _ in range(60):
            time.now += SECOND
            assert allowance.take(round(RATE)) == RATE
        time.now += stall * SECOND
        assert allowance.take(round(stall * RATE)) == stall * RATE


@pytest.mark.parametrize("block", [1, 128])
def test_a_flood_is_cut_to_the_multiple_of_the_rate(block: int) -> None:
    time = Time()
    allowance = Allowance(RATE, time, never)
    sent = taken = 0
    seconds = 100
    for second in range(seconds):
        while sent < 20_000 * (second + 1):
            taken += allowance.take(block)
            sent += block
            time.now += block * SECOND // 20_000
    most = BACKLOG * RATE + MULTIPLE * RATE * seconds
    assert 0.95 * most < taken <= most


def test_events_of_a_kind_that_repeat_are_counted_and_told_after_a_minute() -> None:
    repeats, start = Repeats(), 5 * SECOND
    told = sum(repeats.tell("message", start + i * 1_000_000) for i in range(20_000))
    assert told == MOST
    assert repeats.tell("mode", start + SECOND), "other kinds are not held back"
    assert repeats.over(start + 59 * SECOND) == []
    assert repeats.over(start + 60 * SECOND) == [("message", 20_000 - MOST)]
    assert repeats.tell("message", start + 61 * SECOND)
    assert repeats.over(start + 300 * SECOND) == []


def test_a_text_of_a_device_is_one_line_of_the_log() -> None:
    assert one_line("hot\n2026-11-23 ERROR all is lost\x1b[2J") == "hot 2026-11-23 ERROR all is lost [2J"
    assert len(one_line("x" * 10_000)) == LONGEST + 2
    assert one_line("robot mode: normal → protective stop") == "robot mode: normal → protective stop"


# a source ------------------------------------------------------------------------------------------


class Silent:
    """A driver with one stream on a clock of its own, fed by the test."""

    least_delay = (0.0, 0.001)
    rates: Mapping[str, float] = {}
    streams = (Stream("rtde", (Channel("joint_1.position", "rad"),), RATE, "device"),)


class Fed:
    """A source, what it gave and the alarms that a look each second raised."""

    def __init__(self) -> None:
        self.time = Time()
        self.batches: list[Batch] = []
        self.events: list[Event] = []
        self.source = Source("arm", lambda *_: Silent(), None, self.time, self.batches.append, self.events.append)
        self.source.state = "ok"
        self.watch = Monitor()
        self.alarms = []

    def feed(self, device_time: list[int], values: np.ndarray | None = None) -> None:
        times = np.array(device_time)
        values = np.zeros((len(times), 1)) if values is None else values
        self.source.account.expect(len(times))
        self.source.emit(Reading(Silent.streams[0], values, self.time.now, times))

    def look(self) -> None:
        self.source.settle()
        status = {"sources": {"arm": self.source.status()}, "stages": {}, "sinks": {}}
        self.alarms += self.watch.look(status, self.time.now)

    @property
    def samples(self) -> int:
        return sum(len(batch) for batch in self.batches)


def test_samples_beyond_the_rate_are_dropped_counted_and_told(caplog: pytest.LogCaptureFixture) -> None:
    fed = Fed()
    device = 10 * SECOND
    with caplog.at_level(logging.INFO):
        for _ in range(40):
            for _ in range(10):
                fed.time.now += SECOND // 10
                fed.feed([device + i for i in range(2000)])
                device += SECOND // 10
            fed.look()
    account = fed.source.account
    assert account.residue == 0 and account.expected == 40 * 20_000
    assert account.received == fed.samples <= BACKLOG * RATE + 41 * MULTIPLE * RATE
    assert account.dropped["beyond its rate"] == account.expected - account.received > 0
    assert [b.sequence for b in fed.batches] == np.cumsum([0, *map(len, fed.batches[:-1])]).tolist()
    assert [(a.kind, a.source) for a in fed.alarms] == [("source_strange", "arm")]
    assert "beyond its rate" in fed.alarms[0].statement
    assert len(caplog.records) == len(fed.events) == 1


def test_a_flood_while_who_records_stands_still_costs_a_neighbour_nothing() -> None:
    class Wide(Silent):
        streams = (Stream("rtde", tuple(Channel(f"joint_{i}.position", "rad") for i in range(1, 7)), RATE, "host"),)

    time, raw = Time(), Shared.of({"loud": Wide.streams, "quiet": Wide.streams}, Layout((), 50.0)).raw
    writer, reader = ItemWriter(raw), ItemReader(raw, TELL)
    loud, quiet = (
        Source(name, lambda *_: Wide(), None, time, writer.put, [].append, crowded=lambda: raw.crowded(TELL))
        for name in ("loud", "quiet")
    )
    for _ in range(300):
        time.now += SECOND // 100
        for source, rate in ((loud, 40 * RATE), (quiet, RATE)):
            source.emit(Reading(Wide.streams[0], np.zeros((round(rate / 100), 6)), time.now))
    assert loud.account.dropped["beyond its rate"] > 10 * RATE
    assert not quiet.account.dropped
    items = list(reader.items())
    assert sum(len(item) for item in items if isinstance(item, Batch) and item.source == "quiet") == 3 * RATE
    assert not reader.skipped


def test_a_clock_that_runs_backwards_is_one_line_and_one_alarm(caplog: pytest.LogCaptureFixture) -> None:
    fed = Fed()
    with caplog.at_level(logging.INFO):
        for i in range(1125):
            fed.time.now += SECOND // 125
            fed.feed([100 * SECOND - i * SECOND // 125])
            if i % 125 == 124:
                fed.look()
    assert fed.samples == 1125 and fed.source.account.residue == 0, "no sample is lost"
    assert fed.source.clocks["rtde"].resets == 1124
    assert len(caplog.records) == len(fed.events) == 1
    assert [(a.kind, a.source, a.active) for a in fed.alarms] == [("clock_unsteady", "arm", True)]
    assert fed.alarms[0].statement.endswith(f"{fed.source.clocks['rtde'].state().reason}.")
    fed.time.now += 60 * SECOND
    fed.source.settle()
    assert [e.kind for e in fed.events] == ["clock_step", "clock_step"] and "1123 more" in fed.events[1].text
