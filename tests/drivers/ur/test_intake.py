"""From packages to the account: losses, resets, repeated packages, states."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt import Identity, ProtocolError, Stream
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Selection

from ..inlet import CollectingInlet

RATE = 500.0
START = 1_790_000_000_000_000_000
CHANNELS = Selection.of(["joint_1.position", "robot_mode", "safety_mode", "runtime_state"]).channels


class Cell(CollectingInlet):
    """An inlet whose time the test sets, and an intake on it."""

    def __init__(self) -> None:
        super().__init__()
        self.time = START
        self.intake = Intake(self, Stream("rtde", CHANNELS, RATE, "device"))
        self.open()

    def now(self) -> int:
        return self.time

    def open(self) -> None:
        self.intake.opened(Identity("Universal Robots", "e-Series"), RATE, RATE)

    def feed(self, stamps, not_before: int | None = None, states=(7, 1, 2)) -> None:
        """Packages with these controller times (s), arriving together as the last one is made."""
        stamps = np.asarray(stamps, dtype=np.float64)
        values = np.column_stack([stamps, *(np.full(len(stamps), float(s)) for s in states)])
        self.intake.take(stamps, values, not_before)

    def run(self, first: float, n: int, block: int = 5) -> float:
        """n packages on the grid in blocks, the cell's time going along; returns the last controller time."""
        stamps = first + np.arange(n) / RATE
        for i in range(0, n, block):
            part = stamps[i : i + block]
            self.time += round(len(part) / RATE * 1e9)
            self.feed(part)
        return float(stamps[-1])


@pytest.fixture
def cell() -> Cell:
    return Cell()


@pytest.mark.parametrize("later", [0.0, 55.0, 60.7])
def test_after_a_reboot_no_loss_is_invented(cell, later):
    cell.run(60.0, 500)
    cell.open()
    cell.time += 90_000_000_000
    cell.feed([later], not_before=cell.time)
    assert len(cell.resets) == 1
    assert cell.account.expected == cell.account.received == 501
    assert cell.run(later + 0.002, 60) and not cell.account.missed


@pytest.mark.parametrize("jump", [-30.0, -0.5, 0.05, 30.0])
def test_a_jump_of_the_clock_while_connected_is_reported_once(cell, jump):
    last = cell.run(60.0, 300)
    cell.time += 2_000_000
    cell.feed([last + 0.002], not_before=cell.time)
    for i in range(2, 200):
        cell.time += 2_000_000
        cell.feed([last + i * 0.002 + jump], not_before=cell.time if i % 50 == 0 else None)
    assert len(cell.resets) == 1
    assert not cell.account.missed
    assert cell.account.expected == cell.account.received == 499


def test_a_jump_inside_a_block_splits_it(cell):
    last = cell.run(60.0, 100)
    cell.time += 10_000_000
    cell.feed([last + 0.002, last + 0.004, 5.0, 5.002, 5.004])
    assert len(cell.resets) == 1
    assert [len(r.values) for r in cell.readings[-2:]] == [2, 3]
    assert cell.readings[-1].device_time.tolist() == [5_000_000_000, 5_002_000_000, 5_004_000_000]
    assert cell.account.expected == 105 and not cell.account.missed


def test_a_repeated_timestamp_is_dropped_and_counted(cell):
    last = cell.run(60.0, 100)
    cell.feed([last])
    cell.feed([last, last + 0.002, last + 0.002, last + 0.004])
    assert cell.account.dropped == {"repeated timestamp": 3}
    assert cell.account.received == 102 and cell.account.residue == 0
    assert np.all(np.diff(cell.device_time) > 0)


def test_a_bracket_is_passed_on_a_cycle_earlier(cell):
    cell.run(60.0, 10)
    cell.time += 2_000_000
    cell.feed([60.020], not_before=cell.time - 400_000)
    assert cell.brackets == [(60_020_000_000, cell.time - 400_000 - 2_000_000)]


def test_changes_of_state_are_events(cell):
    cell.feed([1.0, 1.002], states=(7, 1, 2))
    cell.feed([1.004, 1.006], states=(7, 3, 4))
    cell.feed([1.008], states=(77, 3, 4))
    assert [(kind, data["before"], data["after"]) for kind, _, data in cell.events] == [
        ("safety mode", "normal", "protective stop"),
        ("program", "playing", "paused"),
        ("robot mode", "running", "77"),
    ]


def test_a_slower_source_is_told_once(cell):
    cell.feed(60.0 + np.arange(200) * 0.008)
    assert cell.kinds() == ["rate"]
    assert cell.events[0][2]["rate"] == pytest.approx(125.0)
    assert not cell.account.missed


@pytest.mark.parametrize("stamp", [-0.002, float("nan"), float("inf"), 1e10])
def test_a_time_that_cannot_be_is_refused(cell, stamp):
    with pytest.raises(ProtocolError, match="not a time"):
        cell.feed([60.0, stamp])
    assert cell.account.expected == 0
