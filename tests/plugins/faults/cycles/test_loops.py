import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.loops import closed_spans, find_loops
from cellwatt_plugins.faults.cycles.runs import Run


def runs_of(*poses):
    """Runs through poses given by numbers, one after the other."""
    return [
        Run(100 * k, 100 * k + 60, np.array([a, 0.0]), np.array([b, 0.0]), (np.zeros(2), np.zeros(2)))
        for k, (a, b) in enumerate(pairwise(poses))
    ]


def test_tasks_are_found_among_moves_between_them():
    a, b = [0, 1, 2, 3], [9, 8, 7]
    order = [*a, *a, 0, *b, *b, *b, 9, *a, *a, 0, *b, 9]
    found = find_loops(runs_of(*order))
    assert {loop.moves for loop in found} == {((0, 1), (1, 2), (2, 3), (3, 0)), ((4, 5), (5, 6), (6, 4))}
    assert [len(loop.starts) for loop in found] == [4, 4]


def in_order(order):
    """Number of moves and of cycles of each loop found in tasks from pose 0 that run in an ``order``."""
    poses = {"A": [0, 1, 2], "F": [0, 5, 6, 7], "K": [0, 9]}
    found = find_loops(runs_of(*(pose for task in order for pose in poses[task]), 0))
    return sorted((len(loop.moves), len(loop.starts)) for loop in found)


@pytest.mark.parametrize(
    "order, learnt",
    [
        ("AFFAAFAFFA", [(3, 5), (4, 5)]),
        ("FAAAFFAFAFF", [(3, 5), (4, 6)]),
        ("AFAFAFA", [(7, 3)]),
        ("FAFAFAFA", [(7, 4)]),
        ("AKFAKFAKFAK", [(9, 3)]),
        ("AAFAAFAAFAA", [(10, 3)]),
    ],
)
def test_tasks_from_one_pose_are_told_apart_by_their_order(order, learnt):
    """A task that passes its start pose is one task, even if the recording ends in it."""
    assert in_order(order) == learnt


def test_loops_of_an_unknown_task_are_cut_into_turns():
    assert closed_spans(runs_of(9, 0, 1, 2, 0, 1, 2, 0, 8), 3) == [(1, 3), (4, 6)]
    assert closed_spans(runs_of(0, 1, 2, 3), 3) == []


def test_a_day_of_an_unknown_task_takes_little_memory():
    runs = runs_of(*[0, 1, 2] * 500, 0)
    tracemalloc.start()
    spans = closed_spans(runs, 3)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert spans == [(k, k + 2) for k in range(0, 1500, 3)]
    assert peak < 5e6
