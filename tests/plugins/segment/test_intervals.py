import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_plugins.segment.intervals import Segmenter
from tests.plugins.segment.motions import Leg, follow, positions, since_start

STEP = 20_000_000  # ns


def cut(time, q, step=STEP):
    segmenter = Segmenter("arm", q.shape[1], step)
    return segmenter.update(time, q) + segmenter.finish()


def segment(legs, seconds, *, rate=50.0, **options):
    return cut(*positions(legs, seconds, rate=rate, **options), round(1e9 / rate))


def closed(found):
    return [i for i in found if i.closed]


def moving(found):
    return [i for i in closed(found) if i.moving]


@pytest.mark.parametrize("rate", [20.0, 125.0])
@pytest.mark.parametrize("smooth", [True, False])
def test_starts_and_ends_are_those_of_the_motion(rate, smooth):
    legs = [Leg(1.0, {1: 0.8}, 0.9, smooth), Leg(2.3, {2: -0.5, 4: 0.7}, 0.8, smooth), Leg(3.6, {3: 1.1}, 1.0, smooth)]
    found = moving(segment(legs, 6.0, rate=rate))
    assert [i.moving for i in found] == [(1,), (2, 4), (3,)]
    for interval, leg in zip(found, legs, strict=True):
        assert since_start(interval.start) == pytest.approx(leg.at, abs=2.5 / rate)
        assert since_start(interval.end) == pytest.approx(leg.at + leg.seconds, abs=2.5 / rate)
        for joint, by in leg.by.items():
            assert interval.displacement[joint - 1] == pytest.approx(by, abs=3e-3)


def test_intervals_join_without_a_hole_and_count_up():
    found = closed(segment(follow([{1: 0.5}, {2: 0.4}, {1: -0.5}, {2: -0.4}]), 7.0))
    assert [i.moving for i in found] == [(), (1,), (), (2,), (), (1,), (), (2,), ()]
    assert [i.number for i in found] == list(range(1, 10))
    assert all(a.end == b.start for a, b in itertools.pairwise(found))
    assert [i.complete for i in found] == [False, *[True] * 7, False]


def test_each_interval_is_announced_while_it_runs():
    found = segment(follow([{1: 0.5}, {2: 0.4}]), 4.0)
    for interval in moving(found):
        early = next(i for i in found if not i.closed and i.number == interval.number)
        assert early.moving == interval.moving
        assert early.start == interval.start
        assert since_start(early.end) - since_start(early.start) < 0.3
        assert found.index(early) < found.index(interval)


def test_a_joint_that_joins_midway_begins_another_interval():
    found = moving(segment([Leg(1.0, {1: 1.5}, 2.0), Leg(1.8, {2: 0.8}, 1.2)], 5.0))
    assert [i.moving for i in found] == [(1,), (1, 2)]
    assert since_start(found[1].start) == pytest.approx(1.8, abs=0.05)


def test_joints_of_one_motion_are_one_interval_though_one_hardly_moves():
    (found,) = moving(segment([Leg(1.0, {1: 1.2, 2: -0.9, 4: 0.05}, 1.4)], 4.0))
    assert found.moving == (1, 2, 4)


def test_a_joint_that_vibrates_does_not_hold_up_the_intervals_of_the_others():
    time, q = positions([Leg(2.0 + 4 * k, {1: 0.5 * (-1) ** k}, 1.0) for k in range(10)], 45.0)
    q[:, 1] += math.radians(0.1) * np.sin(10 * math.pi * (time - time[0]) * 1e-9)
    segmenter = Segmenter("arm", 4, STEP)
    ends = [since_start(i.end) for i in moving(segmenter.update(time, q)) if 1 in i.moving]
    assert ends == pytest.approx([3.0 + 4 * k for k in range(10)], abs=0.1)


def test_a_turn_without_rest_is_a_boundary():
    t = np.arange(600) / 100
    q = np.zeros((600, 2))
    q[:, 0] = np.where((t > 1) & (t < 5), 0.4 * (1 - np.cos((t - 1) * math.pi)), 0)  # half a swing a second
    found = moving(cut(np.round(t * 1e9).astype(np.int64), q, 10_000_000))
    assert [i.moving for i in found] == [(1,)] * 4
    assert [i.displacement[0] for i in found] == pytest.approx([0.8, -0.8, 0.8, -0.8], abs=0.01)
    assert [i.start * 1e-9 for i in found] == pytest.approx([1, 2, 3, 4], abs=0.04)


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-4, 1e-3])
def test_noise_is_not_motion_and_motion_not_noise(noise):
    still = closed(segment([], 20.0, noise=noise, seed=4))
    assert [i.moving for i in still if since_start(i.end) > 2.0] == [()]  # the first second teaches the noise
    found = moving(segment(follow([{1: 0.8}, {2: 0.8}], at=3.0), 7.0, noise=noise))
    assert [i.moving for i in found if since_start(i.end) > 2.0] == [(1,), (2,)]


def test_a_gap_cuts_the_interval():
    time, q = positions(follow([{1: 0.8}, {2: 0.8}]), 5.0)
    q[70:85, 0] = np.nan  # 0.3 s in the midst of the first move
    found = moving(cut(time, q))
    assert [(i.moving, i.complete) for i in found] == [((1,), False), ((1,), False), ((2,), True)]
    assert since_start(found[0].end) == pytest.approx(69 / 50, abs=1e-6)
    assert since_start(found[1].start) >= 85 / 50


def test_a_few_missing_frames_are_bridged():
    time, q = positions(follow([{1: 0.8}]), 3.0)
    q[70:73] = np.nan
    found = moving(cut(time, q))
    assert [(i.moving, i.complete) for i in found] == [((1,), True)]


def test_a_gap_is_known_before_the_data_come_back():
    time, q = positions(follow([{1: 0.8}]), 3.0)
    q[70:] = np.nan
    segmenter = Segmenter("arm", 4, STEP)
    found = segmenter.update(time, q)
    assert found[-1].closed
    assert not found[-1].complete
    assert segmenter.finish() == []


TIME, Q = positions(
    [
        *follow([{1: 0.8}, {2: 0.5, 3: -0.6}, {3: 0.6}, {1: -0.8, 2: -0.5}]),
        Leg(6.0, {4: 0.9}, 1.5),
        Leg(6.6, {1: 0.5}, 0.6),
        Leg(7.6, {4: -0.9}, 1.0),
    ],
    10.0,
)
Q[430:445, 2] = np.nan


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 499), max_size=12, unique=True))
def test_blocks_of_any_size_give_the_same_intervals(cuts):
    pieces = Segmenter("arm", 4, STEP)
    found = []
    for part in np.split(np.arange(len(TIME)), sorted(cuts)):
        found += pieces.update(TIME[part], Q[part])
    assert found + pieces.finish() == cut(TIME, Q)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10_000))
def test_intervals_are_ordered_and_long_enough_whatever_the_motion(seed):
    random = np.random.default_rng(seed)
    legs = [
        Leg(random.uniform(0, 8), {random.integers(1, 5): random.uniform(-1, 1)}, random.uniform(0.2, 3))
        for _ in range(8)
    ]
    found = closed(segment(legs, 12.0, seed=seed))
    assert [i.number for i in found] == list(range(1, len(found) + 1))
    for a, b in itertools.pairwise(found):
        assert a.end <= b.start
        assert b.start - a.end < 0.2e9
    assert all(i.end > i.start for i in found)
