import time
from dataclasses import dataclass
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.clock.cell import CellClock

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


@dataclass
class Host:
    """A host whose wall clock can be set by hand."""

    since_boot_ns: int = 5_000
    set_by: int = 0

    def since_boot(self) -> int:
        return self.since_boot_ns

    def wall(self) -> int:
        return START + self.since_boot_ns + self.set_by


def slew_ppm(clock: CellClock) -> float:
    """Present rate of the cell's time relative to the host's clock, ppm."""
    return clock._line[2] * 1e6


def on_a_host() -> tuple[CellClock, Host]:
    host = Host()
    return CellClock(wall=host.wall, since_boot=host.since_boot), host


def test_reads_utc_of_this_machine():
    clock = CellClock()
    before = time.time_ns()
    now = clock.now()
    after = time.time_ns()
    assert before - SECOND // 100 < now < after + SECOND // 100


def test_follows_the_host_while_nobody_sets_its_clock():
    clock, host = on_a_host()
    for _ in range(10):
        host.since_boot_ns += SECOND
        assert clock.discipline() == 0
        assert clock.now() == host.wall()
        assert clock.utc_error_ns == slew_ppm(clock) == 0


def test_runs_on_while_the_pc_is_suspended(monkeypatch):
    host = Host()
    suspended = 0
    clocks = {time.CLOCK_BOOTTIME: host.since_boot, time.CLOCK_MONOTONIC: lambda: host.since_boot() - suspended}
    monkeypatch.setattr(time, "clock_gettime_ns", lambda clock: clocks[clock]())
    monkeypatch.setattr(time, "monotonic_ns", clocks[time.CLOCK_MONOTONIC])
    clock = CellClock(wall=host.wall)
    suspended = 3600 * SECOND
    host.since_boot_ns += suspended
    assert clock.now() == host.wall()
    assert clock.discipline() == 0


@pytest.mark.parametrize("step", [3 * SECOND, -3 * SECOND, 2_000_000, -3600 * SECOND])
def test_a_step_of_the_wall_clock_is_reported_and_not_followed_by_a_jump(step):
    clock, host = on_a_host()
    host.since_boot_ns += SECOND
    clock.discipline()
    before = clock.now()
    host.set_by += step

    assert clock.discipline() == step

    assert clock.utc_error_ns == -step
    assert clock.now() == before
    assert clock.discipline() == 0


@pytest.mark.parametrize(("step", "within"), [(20_000_000, 2000), (-SECOND, 12_000)])
def test_a_deviation_is_slewed_away_gently(step, within):
    clock, host = on_a_host()
    host.set_by = step
    slews = [0.0]
    for _ in range(within):
        host.since_boot_ns += SECOND
        clock.discipline()
        slews.append(slew_ppm(clock))
        assert clock.utc_error_ns * -step >= -abs(step) * 20_000  # it does not swing past by more than 20 µs
    assert abs(clock.utc_error_ns) < 20_000
    assert abs(slew_ppm(clock)) < 0.05
    turns = [abs(b - a) for a, b in pairwise(slews)]
    assert max(turns) <= 0.0501
    assert max(map(abs, slews)) <= 500


@given(
    st.lists(st.tuples(st.integers(0, 10 * SECOND), st.integers(-10 * SECOND, 10 * SECOND), st.booleans()), max_size=60)
)
def test_never_steps_back(moves):
    clock, host = on_a_host()
    last = clock.now()
    for passed, step, disciplined in moves:
        host.since_boot_ns += passed
        host.set_by += step
        if disciplined:
            clock.discipline()
        now = clock.now()
        assert now >= last
        assert now - last >= int(passed * (1 - 501e-6)) - 2
        last = now
