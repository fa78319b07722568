import time
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.cell_clock import CellClock

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


@dataclass
class Host:
    """A host whose wall clock can be set by hand."""

    monotonic_ns: int = 5_000
    set_by: int = 0

    def monotonic(self) -> int:
        return self.monotonic_ns

    def wall(self) -> int:
        return START + self.monotonic_ns + self.set_by


def clock_on(host: Host) -> CellClock:
    return CellClock(wall=host.wall, monotonic=host.monotonic)


def test_reads_utc_of_this_machine():
    clock = CellClock()
    before = time.time_ns()
    now = clock.now()
    after = time.time_ns()
    assert before - SECOND // 100 < now < after + SECOND // 100


def test_follows_the_host_while_nobody_sets_its_clock():
    host = Host()
    clock = clock_on(host)
    for _ in range(10):
        host.monotonic_ns += SECOND
        assert clock.discipline() == (0, 0.0)
        assert clock.now() == host.wall()
        assert clock.utc_error_ns == 0


@pytest.mark.parametrize("step", [3 * SECOND, -3 * SECOND, 2_000_000, -3600 * SECOND])
def test_a_step_of_the_wall_clock_is_reported_and_not_followed_by_a_jump(step):
    host = Host()
    clock = clock_on(host)
    host.monotonic_ns += SECOND
    clock.discipline()
    before = clock.now()
    host.set_by += step

    correction = clock.discipline()

    assert correction.step_ns == step
    assert clock.steps == 1
    assert clock.utc_error_ns == -step
    assert clock.now() == before
    assert clock.discipline().step_ns == 0


def test_a_deviation_is_slewed_away_at_no_more_than_500_ppm():
    host = Host()
    clock = clock_on(host)
    host.set_by = 5_000_000
    passed = 0
    for _ in range(40):
        clock.discipline()
        before = clock.now()
        host.monotonic_ns += SECOND
        passed = clock.now() - before
        assert SECOND <= passed <= SECOND + 500_000
    clock.discipline()
    assert abs(clock.utc_error_ns) < 1_000
    assert abs(clock.slew_ppm) < 1


def test_a_late_turn_does_not_make_the_slew_overshoot():
    host = Host()
    clock = clock_on(host)
    host.set_by = 800_000
    clock.discipline()
    host.monotonic_ns += 2 * SECOND
    clock.discipline()
    assert -800_000 <= clock.utc_error_ns <= 0


def test_a_change_of_slew_is_reported():
    host = Host()
    clock = clock_on(host)
    host.set_by = SECOND
    assert clock.discipline().slew_change_ppm == pytest.approx(500)
    assert clock.slew_ppm == pytest.approx(500)
    host.monotonic_ns += SECOND
    host.set_by = 0
    assert clock.discipline().slew_change_ppm == pytest.approx(-750, abs=1)


@given(
    st.lists(st.tuples(st.integers(0, 10 * SECOND), st.integers(-10 * SECOND, 10 * SECOND), st.booleans()), max_size=60)
)
def test_never_steps_back(moves):
    host = Host()
    clock = clock_on(host)
    last = clock.now()
    for passed, step, disciplined in moves:
        host.monotonic_ns += passed
        host.set_by += step
        if disciplined:
            clock.discipline()
        now = clock.now()
        assert now >= last
        assert now - last >= int(passed * (1 - 501e-6)) - 2
        last = now
