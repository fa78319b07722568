import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.match import begun_cycle
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import find_runs
from tests.plugins.faults.cycles.arm_of_points import Cycle, Fault, run
from tests.plugins.faults.cycles.conftest import recorded


def begun(known, cycle, moves):
    """The match of a cycle of which so many moves have gone."""
    measured = run([Cycle("A"), cycle], seed=25)
    own = [r for r in find_runs(recorded(measured)) if measured.time[r.first] > measured.spans[1][0] - 0.1]
    until = own[moves - 1].last + 25
    recording = Recording(measured.time[:until], measured.position[:until], measured.power[:until])
    return begun_cycle(recording, find_runs(recording), known.patterns)


def test_a_cycle_under_way_is_known_by_the_joints_that_keep_to_their_path(known):
    """Joint 4 goes too far in the first move of task B: joint 2 keeps to its path in that one, joint 1 in the next."""
    cycle = Cycle("B", faults=(Fault("encoder_scale", 3, 0.2),))
    matches = [begun(known, cycle, moves) for moves in (1, 2, 3)]
    assert [match.odd for match in matches] == [(3,)] * 3
    odds = [match.known for match in matches]
    assert 0.0 < odds[0] < odds[1] < odds[2]
    # By chance a joint ends within 0.4 degrees on either side of a place in a range of one radian.
    assert odds[0] == pytest.approx(np.log(1.0 / 0.014), abs=0.5)
