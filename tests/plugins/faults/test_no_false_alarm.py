"""What is no fault must not alarm."""

import numpy as np
import pytest

from tests.plugins.faults.plant import OTHER, Cycle, frames, recorded, run
from tests.plugins.faults.watching import more, watch


def alarms_of(reference, cycles, *, seed=1):
    return watch(reference, recorded(cycles, seed=seed))


@pytest.mark.parametrize("seed", [0, 1, *more(2, 3, 4)])
def test_healthy_cycles(reference, seed):
    assert alarms_of(reference, [Cycle()] * 8, seed=seed) == []


@pytest.mark.parametrize("late", [-2, 2, *more(-1, 1)])
def test_power_that_lags_or_leads_by_frames(reference, late):
    positions, power, _ = run([Cycle()] * 6, seed=3)
    assert watch(reference, frames(positions, np.roll(power, late))) == []


def paused(*stops):
    """Cycles with a pause in the midst of a move: its index, the share of the way that is behind the arm."""
    return [[Cycle(), Cycle(), Cycle(pause=(*stop, 1.0)), Cycle(), Cycle()] for stop in stops]


@pytest.mark.parametrize(
    "cycles",
    [
        pytest.param([Cycle(rests={1: 1.5, 3: 0.7}), Cycle(), Cycle(rests={4: 8.0}), Cycle()], id="longer rests"),
        pytest.param([Cycle(standby=15)] * 4, id="a supply that draws more"),
        pytest.param([Cycle(standby=2.0 * k) for k in range(10)], id="a supply that drifts"),
        *paused((1, 0.7), (2, 0.7), (4, 0.3)),
        *more(*paused((0, 0.7), (1, 0.3), (3, 0.3))),
    ],
)
def test_rests_pauses_and_the_supply(reference, cycles):
    assert alarms_of(reference, cycles) == []


def test_a_fan_that_switches_while_the_arm_moves(reference):
    positions, power, starts = run([Cycle()] * 5, seed=4)
    power[round((starts[2] + 0.45) * 50) :] += 25.0
    assert watch(reference, frames(positions, power)) == []


@pytest.mark.parametrize("speed", [0.96, 1.04])
def test_a_speed_override_of_a_few_per_cent(reference, speed):
    found = alarms_of(reference, [Cycle(), Cycle(speed=speed), Cycle(speed=speed), Cycle()])
    assert [a for a in found if a.severity != "info"] == []


@pytest.mark.parametrize("speed", [0.6, 1.3, *more(0.4, 0.8)])
def test_a_speed_that_was_not_learned(reference, speed):
    assert alarms_of(reference, [Cycle()] * 2 + [Cycle(speed=speed)] * 4 + [Cycle()] * 2) == []


def test_an_unknown_task_is_said_each_time_that_it_begins(reference):
    found = alarms_of(reference, [Cycle()] * 2 + [Cycle(OTHER)] * 4 + [Cycle()] * 2 + [Cycle(OTHER)] * 3)
    assert [(a.kind, a.severity, a.active) for a in found] == [("new_task", "info", up) for up in (True, False, True)]


@pytest.mark.parametrize("learned", [Cycle(OTHER), Cycle(speed=0.6)])
def test_a_learned_task_or_speed_is_known(rich_reference, learned):
    assert alarms_of(rich_reference, [Cycle()] * 2 + [learned] * 3 + [Cycle()] * 2) == []


HOLES = [("power", 0.3), ("positions", 1.6), ("both", 3.1), ("frames", 0.3)]
OTHER_HOLES = [(what, at) for what, _ in HOLES for at in (0.3, 1.6, 3.1) if (what, at) not in HOLES]


@pytest.mark.parametrize(("what", "at"), [*HOLES, *more(*OTHER_HOLES)])
def test_missing_data(reference, what, at):
    positions, power, starts = run([Cycle()] * 6, seed=6)
    hole = slice(round((starts[3] + at) * 50), round((starts[3] + at + 0.5) * 50))
    if what in ("power", "both"):
        power[hole] = np.nan
    if what in ("positions", "both"):
        positions[hole] = np.nan
    blocks = frames(positions, power, block=1)
    if what == "frames":
        del blocks[hole]
    assert watch(reference, blocks) == []


def test_power_that_never_came(reference):
    positions, power, _ = run([Cycle()] * 4)
    assert watch(reference, frames(positions, np.full_like(power, np.nan))) == []
