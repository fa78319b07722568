"""Wraps, outages and restarts of a board, judged against a simulated board whose truth is known."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_drivers.power_board.clock import MOST_BEHIND, BoardClock, PacketPosition
from tests.drivers.power_board.samples import packet

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
RATE = 123.0


@dataclass
class Simulated:
    """A board switched on at ``START``; ``drift`` of its clock and rate against the cell's, ``offset`` µs added."""

    drift: float = 0.0
    offset: int = 0
    samples: int = 1

    def place(self, clock: BoardClock, number: int, delay: float = 0.01) -> PacketPosition:
        arrival = START + round((number + self.samples - 1) / RATE * (1 + self.drift) * 1e9 + delay * 1e9)
        return clock.place(packet(number, samples=self.samples, late=self.offset), arrival)


def after(numbers: Iterable[int], **what: float) -> tuple[Simulated, BoardClock]:
    """A board of which these packets came, and the clock that saw them."""
    board, clock = Simulated(**what), BoardClock(RATE)
    for number in numbers:
        board.place(clock, number)
    return board, clock


def microseconds(number: int) -> int:
    return round(number / RATE * 1e6)


@settings(deadline=None)
@given(st.integers(0, 2**16 - 1), st.floats(-200e-6, 200e-6), st.integers(0, 2**32))
def test_wraps_of_both_counters_are_followed(first: int, drift: float, seed: int) -> None:
    """Two hours of a board with gaps of up to 40 s: the sequence wraps 13 times, the clock once."""
    rng, board, clock, number = random.Random(seed), Simulated(drift), BoardClock(RATE), first + 1
    start = board.place(clock, first)
    while number < first + 2 * 3600 * RATE:
        place = board.place(clock, number, delay=rng.uniform(0.005, 0.1))
        time = start.time + microseconds(number) - microseconds(first)
        assert place == PacketPosition(start.sequence + number - first, time, "follows")
        number += rng.choice([1, 1, 2, 500, 5000])


@pytest.mark.parametrize(("hours", "drift", "samples"), [(0.1, 0.0, 1), (1, -100e-6, 2), (12, 100e-6, 1)])
def test_outage_is_counted_exactly(hours: float, drift: float, samples: int) -> None:
    board, clock = after(range(0, 2000, samples), drift=drift, samples=samples)
    then = 2000 + samples * round(hours * 3600 * RATE / samples)
    assert board.place(clock, then) == PacketPosition(then, microseconds(then), "follows")


@pytest.mark.parametrize("true_rate", [10.0, 246.0])
def test_wrong_nominal_rate_does_no_harm(true_rate: float) -> None:
    clock = BoardClock(RATE)
    for number in range(70_000):
        place = clock.place(packet(number, rate=true_rate, phases=1), START + round(number / true_rate * 1e9))
        assert (place.sequence, place.verdict) == (number, "follows")


def test_change_of_rate_is_at_most_two_restarts() -> None:
    clock, time, verdicts = BoardClock(100.0), 0, []
    for number in range(600):
        time += 10_000 if number < 300 else 100_000
        made = packet(number)._replace(time=time)
        verdicts.append(clock.place(made, START + time * 1000).verdict)
    assert verdicts.count("restarted") <= 2
    assert set(verdicts) == {"follows", "restarted"}


def test_stalled_link_that_catches_up_is_no_restart() -> None:
    board, clock = after(range(100))
    end = 100 + round(50.0 * RATE)
    for number in range(100, end):  # all arrive together, at the end
        place = board.place(clock, number, delay=0.01 + (end - number) / RATE)
        assert (place.sequence, place.verdict) == (number, "follows")


@pytest.mark.parametrize(("uptime", "away"), [(70.0, 0.3), (3000.0, 400.0), (40_000.0, 5.0)])
def test_restart_is_seen_at_the_first_packet(uptime: float, away: float) -> None:
    """Sequence and clock both begin at 0, which lies on the very line that they came from."""
    end = round(uptime * RATE)
    _, clock = after(range(end - 1000, end))
    restarted = START + round((uptime + away) * 1e9)
    place = clock.place(packet(3), restarted)
    assert place == PacketPosition(3, microseconds(3), "restarted")
    assert clock.place(packet(4), restarted + 8_130_000) == PacketPosition(4, microseconds(4), "follows")


def test_restart_within_the_first_minute_is_seen_after_some_packets() -> None:
    _, clock = after(range(500))
    back = START + 6 * SECOND
    verdicts = [clock.place(packet(n), back + round(n / RATE * 1e9)).verdict for n in range(MOST_BEHIND + 2)]
    assert verdicts == ["behind"] * (MOST_BEHIND - 1) + ["restarted", "follows", "follows"]


def test_counter_that_starts_again_without_the_clock_is_a_restart() -> None:
    _, clock = after(range(20_000, 20_500))
    made = packet(20_500)._replace(sequence=0)
    assert clock.place(made, START + round(20_500 / RATE * 1e9)).verdict == "restarted"
