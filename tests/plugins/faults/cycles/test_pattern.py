import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.pattern import timing
from cellwatt_plugins.faults.cycles.runs import find_runs
from tests.plugins.faults.cycles.conftest import recorded
from tests.plugins.faults.cycles.four_joints import Cycle, run


def test_a_pattern_is_the_healthy_power(known):
    truth = run([Cycle("A")], seed=9, noise=0.0)
    pattern = known.patterns[0]
    runs = find_runs(recorded(truth))
    for move, seen in enumerate(runs):
        found = timing(pattern, move, recorded(truth), (seen.first, seen.last), range(4))
        middle = 0.5 * (found.start + found.end)
        expected = np.interp(middle, truth.time, truth.power)
        assert np.interp(np.mean(pattern.moves[move]), pattern.time, pattern.power) == pytest.approx(expected, abs=2.0)
