"""Samples from messages: what is unchanged, what is lost, and what becomes of strange time stamps."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from cellwatt.channel import Channel, Quality, Stream
from cellwatt_drivers.opc_ua.intake import Intake
from cellwatt_drivers.opc_ua.messages import Item, Message, nanoseconds

from ..inlet import CollectingInlet

MS = 1_000_000
START = 1_700_000_000_000 * MS
PERIOD = 100 * MS
BAD, OVERFLOW, UNCERTAIN = 0x808C_0000, 0x0480, 0x4092_0000


class Bench:
    """An intake of two tags at 10 Hz, and a server whose clock is the cell's, less ``offset``."""

    def __init__(self) -> None:
        self.inlet = CollectingInlet()
        stream = Stream("tags", (Channel("a.x", "A"), Channel("b.x", "V")), 10.0, "device")
        self.intake = Intake("plc", self.inlet, stream)
        self.intake.resume(0.1, 0.1)
        self.sequence = 0

    def tell(self, at: float, *items: Item, skip: int = 0, clock: int = 0) -> None:
        """A message that the server publishes at ``at`` ms, and that comes at once."""
        self.sequence += bool(items) + skip
        number = self.sequence if items else self.sequence + 1
        now = START + round(at * MS)
        self.intake.take(Message(number, now + clock, items), now)

    @property
    def rows(self) -> list[tuple[float, ...]]:
        times = (self.inlet.device_time - START) / MS
        return [(float(t), *map(float, v)) for t, v in zip(times, self.inlet.values, strict=True)]


def item(column: int, at: float, value: float, status: int = 0) -> Item:
    return Item(column, START + round(at * MS), value if status < 0x8000_0000 else float("nan"), status)


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.tell(0, item(0, 0, 1.0), item(1, 3, 2.0))
    return made


def test_values_of_nearly_one_moment_make_one_sample(bench):
    bench.tell(100, item(1, 101, 4.0), item(0, 98, 3.0))
    assert bench.rows == [(3.0, 1.0, 2.0), (101.0, 3.0, 4.0)]


def test_a_value_that_is_not_told_is_unchanged(bench):
    bench.tell(100, item(0, 100, 3.0))
    assert bench.rows[-1] == (100.0, 3.0, 2.0)


def test_samples_in_which_nothing_changed_are_given_up_to_the_last_sign_of_life(bench):
    for at in (100, 200, 300):
        bench.tell(at)
    bench.tell(400, item(0, 401, 5.0))
    assert bench.rows == [(t, 1.0, 2.0) for t in (3.0, 103.0, 203.0, 303.0)] + [(401.0, 5.0, 2.0)]
    assert bench.inlet.account.counters["unchanged"] == 3


def test_a_change_after_a_quiet_time_is_no_ramp(bench):
    bench.tell(500, item(0, 500, 9.0))
    assert [r[1] for r in bench.rows] == [1.0] * 5 + [9.0]


def test_an_overflow_tells_what_was_lost_before_it(bench):
    bench.tell(500, item(0, 303, 9.0, OVERFLOW), item(0, 403, 10.0), item(0, 503, 11.0))
    account = bench.inlet.account
    assert [r[0] for r in bench.rows] == [3.0, 303.0, 403.0, 503.0]
    assert (account.missed["overflow"], account.counters["overflows"], account.residue) == (2, 1, 0)
    assert "overflows" in account.anomalies


def test_messages_that_never_came_are_a_gap(bench):
    bench.tell(300, item(0, 303, 9.0), skip=2)
    account = bench.inlet.account
    assert (account.missed["gap"], account.counters["lost messages"], account.residue) == (2, 2, 0)


def test_a_bad_value_is_missing_and_told_once(bench):
    bench.tell(100, item(0, 103, 0, BAD))
    bench.tell(200, item(0, 203, 0, BAD))
    bench.tell(300, item(0, 303, 7.0))
    assert np.isnan(bench.inlet.values[1:3, 0]).all() and (bench.inlet.values[1:3, 1] == 2.0).all()
    assert bench.inlet.account.counters["bad status"] == 2
    assert bench.inlet.account.counters["status BadSensorFailure"] == 2
    assert bench.inlet.texts("bad_status") == ["plc: a.x BadSensorFailure", "plc: all values are good again"]


def test_a_doubtful_value_is_taken_and_counted(bench):
    bench.tell(100, item(0, 103, 6.0, UNCERTAIN))
    assert bench.rows[-1][1] == 6.0
    assert bench.inlet.account.counters["uncertain"] == 1


def test_values_with_old_time_stamps_are_taken_as_published(bench):
    bench.tell(100, item(0, 0, 3.0))
    bench.tell(200, item(0, 0, 4.0))
    assert [r[1] for r in bench.rows] == [1.0, 3.0, 4.0]
    assert [r[0] for r in bench.rows] == [3.0, 103.0, 203.0]
    assert bench.inlet.readings[-1].quality.tolist() == [Quality.LATE]
    assert bench.inlet.account.counters["stale time stamps"] == 2
    assert bench.inlet.kinds() == ["stale_time"]


def test_a_tag_whose_time_stamps_never_rise_is_told_once_whatever_comes_in_between(bench):
    for at in (100, 300, 500):
        bench.tell(at, item(0, at, 3.0), item(1, 3, float(at)))
        bench.tell(at + 100, item(0, at + 100, 4.0))
    bench.tell(700, item(1, 703, 5.0))
    bench.tell(800, item(1, 703, 6.0))
    assert bench.inlet.kinds() == ["stale_time"] * 2


@pytest.mark.parametrize("jump", [-30_000, 30_000])
def test_a_clock_that_jumps_is_reset(bench, jump):
    bench.tell(100, item(0, 100 + jump, 3.0), clock=jump * MS)
    bench.tell(200, item(0, 200 + jump, 4.0), clock=jump * MS)
    assert len(bench.inlet.resets) == 1
    assert f"{(97 + jump) / 1000:+.3f} s" in bench.inlet.resets[0]
    assert [r[1] for r in bench.rows] == [1.0, 3.0, 4.0]


def test_a_backlog_after_a_stall_is_no_jump_of_the_clock(bench):
    bench.tell(5000, *(item(0, 3 + 100 * k, k) for k in range(1, 50)))
    assert not bench.inlet.resets
    assert len(bench.rows) == 50 and not bench.inlet.account.missed.total()


def test_a_clock_set_back_during_a_longer_outage_is_reset(bench):
    bench.intake.resume(0.1, 0.1)
    bench.sequence = 0
    bench.tell(100_000, item(0, 70_000, 3.0), item(1, 70_000, 4.0), clock=-30_000 * MS)
    assert len(bench.inlet.resets) == 1 and not bench.inlet.account.missed.total()


def test_samples_of_an_outage_are_lost(bench):
    bench.intake.resume(0.1, 0.1)
    bench.sequence = 0
    bench.tell(1000, item(0, 1003, 3.0), item(1, 1003, 4.0))
    assert bench.inlet.account.missed["outage"] == 9
    assert [r[0] for r in bench.rows] == [3.0, 1003.0]


def test_first_values_that_changed_long_ago_are_of_now():
    bench = Bench()
    bench.tell(0, item(0, -3_600_000, 1.0), item(1, -7_200_000, 2.0))
    bench.tell(200, item(0, 200, 5.0))
    assert [r[0] for r in bench.rows] == [0.0, 100.0, 200.0]
    assert not bench.inlet.resets


def test_a_message_without_its_time_is_of_its_arrival():
    """node-opcua's first messages have none."""
    bench = Bench()
    bench.tell(50, item(0, 40, 1.0), item(1, 40, 2.0), clock=-START - 50 * MS)
    bench.tell(150, item(0, 140, 5.0))
    assert [r[0] for r in bench.rows] == [40.0, 140.0]
    assert not bench.inlet.resets


def test_the_number_of_messages_begins_anew_after_its_largest(bench):
    bench.sequence = 0xFFFF_FFFE
    bench.tell(100, item(0, 103, 2.0))
    bench.sequence = 0
    before = bench.inlet.account.counters["lost messages"]
    bench.tell(200, item(0, 203, 3.0))
    assert bench.inlet.account.counters["lost messages"] == before


@pytest.mark.parametrize("moment", [None, datetime(1601, 1, 1, tzinfo=UTC), datetime(9999, 12, 31, tzinfo=UTC)])
def test_times_that_are_none_are_zero(moment):
    """OPC UA's last moment does not go into 64 bits of ns."""
    assert nanoseconds(moment) == 0


def test_a_time_is_exact_and_without_zone_utc():
    moment = datetime(1970, 1, 1) + timedelta(seconds=1_700_000_000, microseconds=123_457)
    assert nanoseconds(moment) == nanoseconds(moment.replace(tzinfo=UTC)) == 1_700_000_000_123_457_000
