from dataclasses import replace

import numpy as np
import pytest

from cellwatt.results import Interval
from cellwatt_plugins.faults.intervals.follow import Follower, Place
from cellwatt_plugins.faults.reference import load
from cellwatt_plugins.faults.trace import Trace


@pytest.fixture
def follower(rich_reference):
    return Follower(load(rich_reference))


def interval_of(follower, place, **changes):
    """The reference interval as the segmenter would give it, and its frames."""
    reference = follower[place]
    end = round(reference.duration * 1e9)
    speeds = tuple(abs(d) for d in reference.displacement)
    interval = Interval("arm", 1, 0, end, reference.moving, reference.displacement, reference.pose, speeds)
    time = np.arange(0, end, 20_000_000)
    position = np.tile(reference.pose, (len(time), 1))
    for joint, pattern in reference.position.items():
        position[:, joint - 1] = pattern.at(time * 1e-9)
    return replace(interval, **changes), Trace(time, position, np.zeros(len(time)))


def everywhere(follower):
    for i, task in enumerate(follower.reference.tasks):
        for k, variant in enumerate(task.variants):
            for index in range(len(variant.intervals)):
                yield Place(i, k, index)


def test_every_interval_is_known_without_a_sequence_to_follow(follower):
    for place in everywhere(follower):
        assert follower.best(*interval_of(follower, place)).place == place


def test_the_speed_is_known_from_the_path(follower):
    slow = next(
        p for p in everywhere(follower) if len(follower.reference.tasks[p.task].variants) > 1 and p.variant == 1
    )
    found = follower.best(*interval_of(follower, slow))
    assert found.place.variant == 1


def test_other_joints_or_another_pose_are_unknown(follower):
    place = Place(0, 0, 0)
    interval, trace = interval_of(follower, place)
    assert follower.best(replace(interval, moving=(1, 2, 3)), trace) is None
    assert follower.best(replace(interval, pose=tuple(p + 0.5 for p in interval.pose)), trace) is None


def test_one_joint_elsewhere_is_still_the_place(follower):
    interval, trace = interval_of(follower, Place(0, 0, 1))
    pose = (interval.pose[0] + 0.2, *interval.pose[1:])
    found = follower.best(replace(interval, pose=pose), trace)
    assert (found.place, found.displaced) == (Place(0, 0, 1), 1)


def test_the_sequence_tells_what_was_left_out(follower):
    follower.last = Place(0, 0, 0)
    assert follower.best(*interval_of(follower, Place(0, 0, 1))).skipped == 0
    assert follower.best(*interval_of(follower, Place(0, 0, 2))).skipped == 1
    follower.last = follower.after(Place(0, 0, 0), -1)
    assert follower.best(*interval_of(follower, Place(0, 0, 0))).skipped == 0


def test_a_joint_that_does_not_move_is_missed_in_the_sequence_only(follower):
    two = next(p for p in everywhere(follower) if len(follower[p].moving) == 2)
    interval, trace = interval_of(follower, two)
    lame = replace(interval, moving=interval.moving[:1])
    assert follower.best(lame, trace) is None or follower.best(lame, trace).place != two
    follower.last = follower.after(two, -1)
    found = follower.best(lame, trace)
    assert (found.place, found.foreign) == (two, 1)
