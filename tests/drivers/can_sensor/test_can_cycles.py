from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.can_sensor.intake import Cycle

PERIOD = 0.02


def losses(counts_to, numbers, times=None):
    cycle = Cycle(PERIOD, counts_to)
    times = [n * PERIOD for n in numbers] if times is None else times
    return [cycle.lost(t, n % (counts_to or 1)) for n, t in zip(numbers, times, strict=True)]


def test_the_counter_tells_at_once_what_was_lost():
    assert losses(16, [14, 15, 16, 19, 20]) == [0, 0, 0, 2, 0]


@pytest.mark.parametrize("counts_to", [16, None])
@pytest.mark.parametrize("gap", [5, 16, 1000])
def test_every_loss_is_known_soon_after(counts_to, gap):
    numbers = [*range(50), *range(50 + gap, 100 + gap)]
    found = losses(counts_to, numbers)
    assert sum(found[: 50 + 20]) == gap
    assert sum(found) == gap


@pytest.mark.parametrize(("stated", "counts"), [(15, [13, 14, 0, 3]), (4, [14, 15, 0, 3])])
def test_a_counter_restarts_at_its_stated_range_unless_it_exceeds_it(stated, counts):
    """As AUTOSAR's, of 0 to 14 in 4 bits; a stated range may be wrong."""
    cycle = Cycle(PERIOD, 16, stated)
    assert [cycle.lost(n * PERIOD, count) for n, count in zip((0, 1, 2, 5), counts, strict=True)] == [0, 0, 0, 2]


@pytest.mark.parametrize("period", [2 * PERIOD, 0.0])
def test_a_counter_of_all_pages_tells_what_this_page_lost(period):
    cycle, found = Cycle(period, 256, shared=True), []
    for n in range(250, 300):
        if n in (260, 271):  # one of this page, one of the other
            continue
        if n % 2:
            cycle.others += 1
        else:
            found.append(cycle.lost(n * PERIOD, n % 256))
    assert sum(found) == (1 if period else 2)


@pytest.mark.parametrize("counts_to", [16, None])
def test_what_is_only_late_is_not_lost(counts_to):
    numbers = list(range(200))
    times = [n * PERIOD if not 80 <= n < 120 else 120 * PERIOD + n * 1e-4 for n in numbers]
    assert sum(losses(counts_to, numbers, times)) == 0


@pytest.mark.parametrize("counts_to", [16, None])
@pytest.mark.parametrize("pace", [0.99, 1.01])
def test_a_clock_that_is_off_is_no_loss(counts_to, pace):
    numbers = list(range(2000))
    assert sum(losses(counts_to, numbers, [n * PERIOD * pace for n in numbers])) == 0


def test_after_a_pause_in_listening_the_time_is_believed_at_once():
    cycle = Cycle(PERIOD, 16)
    cycle.lost(0.0, 5)
    assert cycle.lost(101 * PERIOD, (5 + 101) % 16, resumed=True) == 100


def test_what_is_sent_on_change_cannot_be_missed():
    cycle = Cycle(0.0, None)
    assert [cycle.lost(t, 0) for t in (0.0, 100.0, 100.1)] == [0, 0, 0]


@given(st.lists(st.integers(0, 200), max_size=30), st.integers(0, 15), st.data())
def test_all_lost_frames_are_counted_despite_jitter(gaps, first, data):
    numbers = [first]
    for gap in [*gaps, *[0] * 60]:
        numbers.append(numbers[-1] + gap + 1)
    jitter = data.draw(st.lists(st.floats(0, 0.04), min_size=len(numbers), max_size=len(numbers)))
    assert sum(losses(16, numbers, [n * PERIOD + j for n, j in zip(numbers, jitter, strict=True)])) == sum(gaps)
