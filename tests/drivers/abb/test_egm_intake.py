"""Packets in any order: what is handed over, what is counted."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.channel import Quality, Stream
from cellwatt_drivers.abb.emulated_robot import EmulatedRobot
from cellwatt_drivers.abb.intake import Intake
from cellwatt_drivers.abb.wire import columns

from ..inlet import CollectingInlet
from .rig import STILL

START = 1_700_000_000.0


class Rig:
    def __init__(self, *groups, axes=6):
        self.inlet = CollectingInlet()
        found = columns(groups or ("joints",), axes, ())
        self.intake = Intake(self.inlet, Stream("egm", found.channels, 250.0, "device"), found, lambda: None)
        self.robot = EmulatedRobot(STILL, 7, 6, 0.004)

    def packet(self, number, at=None, clocked=True, start=START):
        return self.robot.packet(0, number, start + 0.004 * (number if at is None else at), clocked)

    def take(self, *numbers, **how):
        self.intake.take([self.packet(n, **how) for n in numbers])

    @property
    def count(self):
        account = self.inlet.account
        assert account.residue == 0
        return account.expected, account.received, dict(account.missed), dict(account.counters)


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_axes_that_the_settings_leave_out_are_told_once():
    rig = Rig(axes=4)
    rig.take(1, 2)
    rig.intake.opened()
    rig.take(3)
    told = (
        "the controller sends 6 joints and 0 external axes, 'axes' and 'external' name 4 and 0: the others are left out"
    )
    assert rig.inlet.texts() == [told]


def test_a_packet_without_any_of_the_values_is_missing():
    for groups, quality in ((("torque",), Quality.MISSING), (("torque", "joints"), Quality.GOOD)):
        rig = Rig(*groups)
        rig.take(1, 2)
        (reading,) = rig.inlet.readings
        assert reading.quality.tolist() == [quality, quality]


def test_a_pause_after_the_age_of_a_packet_was_read_sets_the_next_ones_arrival_not_back(rig):
    for number, waited in ((1, 0), (2, 1_000_000_000)):
        rig.intake.take([rig.packet(number)], waited)
    first, second = rig.inlet.readings
    assert second.arrival == first.arrival


def test_two_packets_of_one_number_that_differ_are_told_as_forged(rig):
    rig.take(1, 2)
    rig.take(2, at=1.5)
    rig.take(2)
    assert rig.count == (2, 2, {}, {"contradicting packets": 1, "duplicates": 1})
    assert rig.inlet.account.forgeries == {"contradicting packets"}
    assert rig.inlet.account.anomalies == {"duplicates"}


def test_a_number_that_the_time_cannot_have_brought_invents_no_loss(rig):
    rig.take(1, 2)
    rig.take(900_000, at=3)
    rig.take(4, 5)
    assert rig.count == (5, 5, {}, {"sessions": 2})
    assert rig.inlet.account.anomalies == {"sessions"}


def test_numbering_begins_anew_with_a_new_session(rig):
    rig.take(500, 501)
    rig.take(1, at=502)
    rig.take(2, at=503)
    assert rig.count == (4, 4, {}, {"sessions": 1})
    assert rig.inlet.resets == []


def test_a_controller_that_restarts_has_another_clock(rig):
    rig.take(5000, 5001)
    rig.take(1, 2, start=START - 1e6)
    assert rig.count == (4, 4, {}, {"sessions": 1})
    assert rig.inlet.resets == ["the controller's time went back"]


def test_a_clock_that_is_set_is_noticed_and_a_gap_is_not_taken_for_it(rig):
    rig.take(1, 2)
    rig.take(1000)
    assert rig.inlet.resets == []
    rig.take(1001, at=2001)
    assert rig.inlet.resets == ["the controller's time jumped"]


@pytest.mark.parametrize(("every", "rates"), [(2, {"egm": 125.0}), (1, {})])
def test_the_rate_at_which_a_controller_regularly_sends_is_followed(rig, every, rates):
    for number in range(1, 200):
        if number % 70:  # lost packets are no slower rate
            rig.take(number, at=every * number)
    assert rig.intake.rates == rates
    assert rig.inlet.kinds() == ["rate"] * (every - 1)
    assert rig.inlet.account.missed == {"gap": 2} and not rig.inlet.resets


def test_without_a_clock_the_header_counts_and_wraps(rig):
    wrap = 2**32 / 1000
    rig.take(1, 2, 3, clocked=False, start=wrap - 0.010)
    assert rig.count == (3, 3, {}, {})
    np.testing.assert_array_equal(np.diff(rig.inlet.device_time), 4_000_000)
    rig.take(4)
    assert rig.inlet.resets == ["the controller's clock appeared or disappeared"]
