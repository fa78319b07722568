import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.api import learn_from
from cellwatt_plugins.faults.reference import load
from tests.plugins.faults.plant import CYCLE, GRAVITY, HOME, LOSS, OTHER, STANDBY, Cycle, frames, run


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


def test_mean_and_spread_are_those_of_the_cycles(reference):
    _, noisy, starts = run([Cycle()] * 8, seed=50)
    _, power, _ = run([Cycle()] * 8, noise=0.0)
    interval = load(reference).tasks[0].variants[0].intervals[0]
    t = np.asarray(interval.power.time)
    truth = np.interp(starts[3] + t, np.arange(len(power)) / 50, power)
    assert np.abs(interval.power.values - truth).max() < 12.0  # a frame early or late where power is steep
    assert np.median(np.abs(interval.power.values - truth)) < 1.5
    assert np.median(interval.power.spread) == pytest.approx(np.std(noisy - power), rel=0.5)
    holding = (LOSS * (GRAVITY * np.cos(HOME)) ** 2).sum()
    assert interval.power.values[:8].mean() == pytest.approx(STANDBY + holding, abs=1)
    assert interval.position[1].values[0] == pytest.approx(HOME[0], abs=1e-3)


def test_tasks_and_speeds_are_told_apart(rich_reference):
    learned = load(rich_reference)
    found = {
        tuple(i.moving for i in task.variants[0].intervals): [(v.speed, v.cycles) for v in task.variants]
        for task in learned.tasks
    }
    assert found[tuple(tuple(m.by) for m in CYCLE)] == [(1.0, 6), (pytest.approx(0.6, abs=0.01), 4)]
    assert found[tuple(tuple(m.by) for m in OTHER)] == [(1.0, 4)]


def test_too_few_cycles_are_refused():
    positions, power, _ = run([Cycle()] * 2)
    with pytest.raises(ModelError, match=r"3 times or more at one speed \(most: 2\): record more healthy cycles"):
        learn_from(frames(positions, power), None, "arm", "supply.power")


def test_some_missing_power_is_no_harm():
    positions, power, starts = run([Cycle()] * 5)
    power[round(starts[2] * 50) : round(starts[2] * 50) + 40] = np.nan
    reference, _ = learn_from(frames(positions, power), "plant", "arm", "supply.power")
    assert np.isfinite(reference.tasks[0].variants[0].intervals[0].power.values).all()
    assert reference.robot == "plant"


def test_blocks_of_any_size_teach_the_same():
    positions, power, _ = run([Cycle()] * 4, seed=3)
    expected, _ = learn_from(frames(positions, power), None, "arm", "supply.power")
    for block in (1, 33, 5000):
        assert learn_from(frames(positions, power, block=block), None, "arm", "supply.power")[0] == expected
