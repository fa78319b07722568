from itertools import pairwise

import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.learn import learn_patterns
from cellwatt_plugins.faults.cycles.match import begun_cycle, find_cycles
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import find_runs
from tests.plugins.faults.cycles.conftest import recorded
from tests.plugins.faults.cycles.four_joints import HOME_A, RATE, TASKS, Cycle, Fault, move, run


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


@pytest.mark.parametrize("degrees", [0.7, 0.9, 1.1, 1.5, 1.9, 2.1])
@pytest.mark.parametrize("place", [0, 2, 4])
def test_a_task_with_a_short_move_is_learned_and_found(monkeypatch, degrees, place):
    """The short move, first, in the middle or last, is of joint 4, whose encoder is off in the last cycle.

    Joint 2 is stuck in an earlier one.
    """
    short = {3: np.radians(degrees)}
    moves = [{0: 0.9}, {1: 0.6, 2: -0.7}, {0: -0.9, 3: -short[3]}, {1: -0.6, 2: 0.7}]
    if place == 4:
        moves[2], short = {0: -0.9, 3: short[3]}, {3: -short[3]}
    moves.insert(place, short)
    monkeypatch.setitem(TASKS, "short", (HOME_A, moves))
    stuck = Cycle("short", faults=(Fault("encoder_stuck", 1),))
    off = Cycle("short", faults=(Fault("encoder_offset", 3, 0.05),))
    measured = run([Cycle("short")] * 4 + [Cycle("short", 0.98), stuck, Cycle("short"), off], seed=3)
    learned = recorded(run([Cycle("short")] * 4, seed=4))
    recording = recorded(measured)
    patterns = learn_patterns(learned)
    assert [(len(pattern.moves), pattern.cycles) for pattern in patterns] == [(4 if degrees < 0.8 else 5, 4)]
    found = find_cycles(recording, find_runs(recording), patterns)
    assert [(match.odd, match.broken) for match in found] == [((), ())] * 5 + [((1,), ()), ((), ()), ((3,), ())]


@pytest.mark.parametrize(
    "stops, broken",
    [
        ([(0.4, 0.0)], [(1,)]),
        ([(0.3, 0.0), (0.7, 0.0)], [(1,)]),
        ([(0.7, 0.0), (0.3, 0.0)], []),
        ([(0.3, 0.0), (0.7, 0.1)], []),
        ([(0.3, 0.1), (0.7, 0.0)], []),
    ],
)
def test_a_move_with_several_stops_on_its_path_is_a_move(known, stops, broken):
    """``stops`` in the second move of task A: share of the way, and distance of joint 1 from the path, rad."""
    poses = list(np.cumsum([HOME_A, *([by.get(j, 0.0) for j in range(4)] for by in TASKS["A"][1])], axis=0))
    way = poses[2] - poses[1]
    poses[2:2] = [poses[1] + share * way + [aside, 0.0, 0.0, 0.0] for share, aside in stops]
    parts = [np.repeat(HOME_A[None], 80, axis=0)]
    for start, end in pairwise(poses):
        parts += [move(start, end, 0.55 + 0.4 * np.abs(end - start).max()), np.repeat(end[None], 40, axis=0)]
    position = np.concatenate(parts)
    recording = Recording(np.arange(len(position)) / RATE, position, np.zeros(len(position)))
    found = find_cycles(recording, find_runs(recording), known.patterns)
    assert [match.broken for match in found] == broken
