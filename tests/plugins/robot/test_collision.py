"""Poses in which an arm touches itself or the floor."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.collision import Checker, solid
from cellwatt_plugins.robot.description import Capsule
from tests.plugins.models.static import arms
from tests.plugins.robot.planar_arm import L1, write

WIDE = np.array([[-3.0, 3.0], [-3.0, 3.0]])


@pytest.fixture(scope="module")
def mh12():
    return Arm.load("mh12")


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    """Two links along x at zero; a positive angle lowers them."""
    return Arm.load(write(tmp_path_factory.mktemp("planar")))


def outlined(arm, *capsules, floor=0.0):
    """The arm with other rods and floor."""
    return replace(arm, description=arm.description.model_copy(update={"capsules": capsules, "floor": floor}))


def test_poses_through_the_floor_or_into_the_arm_are_not_safe(mh12):
    checker = Checker(mh12, arms.LIMITS)
    straight, down, folded = np.zeros(6), np.array([0, 1.9, -0.9, 0, 0, 0]), np.array([0, 0, -2.55, 0, 0, 0])
    np.testing.assert_array_equal(checker.safe(np.stack([straight, down, folded])), [True, False, False])
    assert checker.safe_move(straight, 0.2 * down)
    assert not checker.safe_move(straight, down)


def test_a_way_through_the_floor_between_two_safe_poses_is_not_safe(mh12):
    """The forearm swings from in front to behind and points down in between."""
    checker = Checker(outlined(mh12, *mh12.description.capsules[-2:], floor=0.6), arms.LIMITS)
    ahead, behind = np.zeros(6), np.array([0, 0, -3.0, 0, 0, 0])
    assert checker.safe(np.stack([ahead, behind])).all()
    assert not checker.safe_move(ahead, behind)


@given(seed=st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_distances_between_rods(seed, planar):
    """Of a rod on the base and one on the last link, against all pairs of 201 points along their axes."""
    rng = np.random.default_rng(seed)
    fixed, moved = (
        Capsule(link=link, start=a, end=b, radius=0.01) for link, (a, b) in enumerate(rng.normal(size=(2, 2, 3)))
    )
    moved = moved.model_copy(update={"link": 2})
    q = rng.uniform(-3, 3, (1, 2))
    frame = planar.forward(q)[0, -1]
    share = np.linspace(0, 1, 201)[:, None]
    one, other = (np.array(rod.start) + share * (np.array(rod.end) - rod.start) for rod in (fixed, moved))
    brute = np.linalg.norm(one[:, None] - (other @ frame[:3, :3].T + frame[:3, 3]), axis=2).min() - 0.02
    (found,) = planar.body.distances([solid(fixed), solid(moved)], [(0, 1)])(q)[0]
    assert found == pytest.approx(brute, abs=0.02)
    assert found <= brute + 1e-9


def test_gaps_are_distances_between_the_rods_and_to_the_floor(planar):
    post = Capsule(link=0, start=(1.0, -0.3, 0.2), end=(1.0, 0.3, 0.2), radius=0.05)
    lower = Capsule(link=2, start=(0, 0, 0), end=(0.6, 0, 0), radius=0.04)
    checker = Checker(outlined(planar, post, lower, floor=-1.0), WIDE)
    raised = np.array([0.0, -np.arctan2(0.2, 1.0 - L1)])
    gaps = checker.gaps(np.array([[0.0, 0.0], [0.0, np.pi / 2], raised]))
    expected = [[0.2, 1.0], [np.hypot(1.0 - L1, 0.2), 0.4], [0.0, 1.0]]
    np.testing.assert_allclose(gaps, np.array(expected) - [0.09, 0.04], atol=1e-9)
    np.testing.assert_array_equal(checker.safe(np.array([[0.0, 0.0], raised])), [True, False])


def test_the_floor_of_an_arm_on_the_ceiling_lies_along_its_gravity(planar):
    ceiling = replace(planar, body=planar.body.with_gravity(np.array([0.0, 0.0, 9.81])))
    lower = Capsule(link=2, start=(0, 0, 0), end=(0.6, 0, 0), radius=0.04)
    checker = Checker(outlined(ceiling, lower, floor=-1.2), WIDE)
    reaching, folded = [-np.pi / 2, 0.0], [-np.pi / 2, np.pi / 2]
    np.testing.assert_array_equal(checker.safe(np.array([reaching, folded])), [False, True])
