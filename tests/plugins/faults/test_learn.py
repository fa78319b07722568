import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.api import learn_from
from cellwatt_plugins.faults.learn import over_cycles
from cellwatt_plugins.faults.reference import load
from tests.plugins.faults.plant import CYCLE, HOME, OTHER, Cycle, recorded


def test_every_interval_of_the_cycle_is_learned(reference):
    learned = load(reference)
    (task,) = learned.tasks
    (variant,) = task.variants
    assert (learned.arm, learned.power, learned.joints) == ("arm", "supply.power", 3)
    assert (variant.speed, variant.cycles) == (1.0, 8)
    assert [i.moving for i in variant.intervals] == [tuple(move.by) for move in CYCLE]
    pose = HOME.copy()
    for interval, move in zip(variant.intervals, CYCLE, strict=True):
        assert interval.pose == pytest.approx(pose, abs=2e-3)
        assert interval.duration == pytest.approx(move.seconds, abs=0.05)
        for joint, by in move.by.items():
            assert interval.displacement[joint - 1] == pytest.approx(by, abs=3e-3)
            pose[joint - 1] += by


def test_tasks_and_speeds_are_told_apart(rich_reference):
    learned = load(rich_reference)
    found = {
        tuple(i.moving for i in task.variants[0].intervals): [(v.speed, v.cycles) for v in task.variants]
        for task in learned.tasks
    }
    assert found[tuple(tuple(m.by) for m in CYCLE)] == [(1.0, 6), (pytest.approx(0.6, abs=0.01), 4)]
    assert found[tuple(tuple(m.by) for m in OTHER)] == [(1.0, 4)]


def test_too_few_cycles_are_refused():
    with pytest.raises(ModelError, match=r"3 times or more at one speed \(most: 2\): record more healthy cycles"):
        learn_from(recorded([Cycle()] * 2), None, "arm", "supply.power")


def test_blocks_of_any_size_teach_the_same():
    blocks = [recorded([Cycle()] * 4, seed=3, block=block) for block in (5, 1, 33, 5000)]
    expected, *others = (learn_from(each, None, "arm", "supply.power").reference.tasks for each in blocks)
    assert others == [expected] * 3


def test_the_spread_is_that_of_the_cycles_with_a_value():
    mean, spread = over_cycles(np.array([[1.0, 2.0], [3.0, np.nan], [np.nan, np.nan]]), "power is")
    assert mean == pytest.approx([2.0, 2.0])
    assert spread == pytest.approx([np.sqrt(2.0), 0.0])
