import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.pattern import timing
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import find_runs
from tests.plugins.faults.cycles.arm_of_points import Cycle, Run, run


def recorded(measured: Run) -> Recording:
    return Recording(measured.time, measured.position, measured.power)


def test_tasks_and_speeds_are_learned(known):
    assert [(p.task, len(p.moves), p.cycles) for p in known.patterns] == [
        ("task_1", 5, 4),
        ("task_1", 5, 2),
        ("task_2", 4, 4),
        ("task_2", 4, 2),
    ]
    assert [p.speed for p in known.patterns] == pytest.approx([1.0, 0.6, 1.0, 0.6], abs=0.01)


def test_a_pattern_is_the_healthy_power(known):
    truth = run([Cycle("A")], seed=9, noise=0.0)
    pattern = known.patterns[0]
    runs = find_runs(recorded(truth))
    for move, seen in enumerate(runs):
        found = timing(pattern, move, recorded(truth), (seen.first, seen.last), range(4))
        middle = 0.5 * (found.start + found.end)
        expected = np.interp(middle, truth.time, truth.power)
        assert np.interp(np.mean(pattern.moves[move]), pattern.time, pattern.power) == pytest.approx(expected, abs=2.0)


def test_a_slower_move_is_timed_by_its_way(known):
    slow = run([Cycle("A", 0.97)], seed=4)
    seen = find_runs(recorded(slow))[0]
    found = timing(known.patterns[0], 0, recorded(slow), (seen.first, seen.last), [0])
    start, end = known.patterns[0].moves[0]
    assert (found.end - found.start) * 0.97 == pytest.approx(end - start, rel=0.01)
    assert found.error < 0.005
