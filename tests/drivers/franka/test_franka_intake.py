"""States in any order: what is handed over, what is counted."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.channel import Stream
from cellwatt_drivers.franka.fields import Selection
from cellwatt_drivers.franka.intake import Intake

from ..inlet import CollectingInlet


class Rig:
    def __init__(self, every: int = 1):
        self.inlet = CollectingInlet()
        self.time = 1_700_000_000_000_000_000
        self.inlet.now = lambda: self.time
        channels = Selection.of(("state",)).channels
        self.intake = Intake(self.inlet, Stream("fci", channels, 1000.0 / every, "device"), every)

    def take(self, *stamps: int, mode: float = 2.0, held: float = 0.0):
        values = np.tile([mode, 0.0, 1.0], (len(stamps), 1))
        self.intake.take(np.array(stamps), np.full(len(stamps), held), values)

    @property
    def count(self):
        account = self.inlet.account
        assert account.residue == 0
        return account.expected, account.received, dict(account.missed)


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_milliseconds_that_are_not_there_are_missed(rig):
    rig.take(100, 101, 103)
    rig.take(107)
    rig.intake.settle()
    assert rig.count == (8, 4, {"gap": 4})
    np.testing.assert_array_equal(rig.inlet.device_time[:3], [100_000_000, 101_000_000, 103_000_000])


def test_as_many_states_as_the_reader_was_kept_from_are_the_hosts(rig):
    rig.take(100)
    rig.take(110)
    rig.take(120, held=10.0)  # the kernel counts late, and in steps
    rig.take(*range(121, 150))
    assert rig.count == (32, 32, {}), "what is missing is told once nothing more is lost"
    rig.take(*range(150, 240))
    assert rig.count == (140, 122, {"host stalled": 10, "gap": 8})


def test_what_kept_the_reader_long_ago_does_not_count(rig):
    rig.take(*range(100, 200), held=1.0)
    rig.take(*range(200, 1500))
    rig.take(1510)
    rig.intake.settle()
    assert rig.count == (1411, 1401, {"gap": 10})


def test_at_a_part_of_the_rate_only_those_kept_are_due():
    rig = Rig(every=4)
    rig.take(100, 104, 112)
    rig.intake.settle()
    assert rig.count == (4, 3, {"gap": 1})


def test_a_new_connection_in_the_same_time_is_an_outage(rig):
    rig.take(100)
    rig.intake.opened()
    rig.time += 2_000_000_000
    rig.take(2100)
    assert rig.count == (2001, 2, {"outage": 1999})
    assert rig.inlet.resets == []


def test_a_restart_during_an_outage_is_found_also_if_the_new_time_is_later(rig):
    rig.take(40_000)
    rig.intake.opened()
    rig.time += 150_000_000_000
    rig.take(60_000)
    assert rig.inlet.resets == ["the robot's time began anew"]
    rig.time += 800_000_000
    rig.take(60_001)  # waited for a PC that stood still
    assert len(rig.inlet.resets) == 1 and rig.count == (3, 3, {})


def test_a_robot_that_started_again_has_another_time(rig):
    rig.take(100_000)
    rig.take(50, 51)
    assert rig.count == (3, 3, {})
    assert rig.inlet.resets == ["the robot's time began anew"]
    rig.take(3_600_051)
    assert len(rig.inlet.resets) == 2
    assert rig.count == (4, 4, {})


def test_a_time_base_that_changes_within_a_block(rig):
    rig.take(100, 101, 3_600_102, 3_600_103, 5, 6)
    assert rig.count == (6, 6, {})
    assert len(rig.inlet.resets) == 2
    assert [len(r.values) for r in rig.inlet.readings] == [2, 2, 2]


def test_states_lost_while_the_pc_stood_still_are_missed_and_the_time_base_stays(rig):
    rig.take(100, 101)
    rig.time += 800_000_000
    rig.take(102, 103, 850, 851)
    rig.intake.settle()
    assert rig.count == (752, 6, {"gap": 746})
    assert rig.inlet.resets == []


def test_modes_that_change_are_reported(rig):
    rig.take(1, 2)
    rig.take(3, mode=4.0)
    rig.take(4, mode=1.0)
    assert rig.inlet.texts() == ["robot mode: move → reflex", "robot mode: reflex → idle"]
