"""Poses in which an arm touches itself or the floor."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt.errors import ConfigError
from cellwatt_plugins.models.static.planning import MH12
from cellwatt_plugins.robot import RigidBody, load_robot
from cellwatt_plugins.robot.collision import CLEARANCE, Capsule, Checker, Outline, distance, read_outline
from tests.plugins.models.static import arms
from tests.plugins.robot.planar_arm import L1, urdf

WIDE = np.array([[-3.0, 3.0], [-3.0, 3.0]])


@pytest.fixture(scope="module")
def mh12():
    robot = load_robot(MH12)
    return RigidBody(robot.urdf, tuple(joint.name for joint in robot.joints))


@pytest.fixture(scope="module")
def planar(tmp_path_factory):
    """Two links along x at zero; a positive angle lowers them."""
    file = tmp_path_factory.mktemp("planar") / "arm.urdf"
    file.write_text(urdf())
    return RigidBody(file, ("shoulder", "elbow"))


def test_poses_through_the_floor_or_into_the_arm_are_not_safe(mh12):
    checker = Checker(mh12, read_outline(MH12, mh12), arms.LIMITS)
    straight, down, folded = np.zeros(6), np.array([0, 1.9, -0.9, 0, 0, 0]), np.array([0, 0, -2.55, 0, 0, 0])
    np.testing.assert_array_equal(checker.safe(np.stack([straight, down, folded])), [True, False, False])
    assert checker.safe_move(straight, 0.2 * down)
    assert not checker.safe_move(straight, down)


def test_a_way_through_the_floor_between_two_safe_poses_is_not_safe(mh12):
    """The forearm swings from in front to behind and points down in between."""
    checker = Checker(mh12, Outline(floor=0.6, capsules=read_outline(MH12, mh12).capsules[-2:]), arms.LIMITS)
    ahead, behind = np.zeros(6), np.array([0, 0, -3.0, 0, 0, 0])
    assert checker.safe(np.stack([ahead, behind])).all()
    assert not checker.safe_move(ahead, behind)


@given(seed=st.integers(0, 1000))
@settings(max_examples=40, deadline=None)
def test_distances_between_rods(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 3, 2, 3))
    share = np.linspace(0, 1, 201)[:, None]
    for k in range(3):
        points = [end[k, 0] + share * (end[k, 1] - end[k, 0]) for end in (a, b)]
        brute = np.linalg.norm(points[0][:, None] - points[1], axis=2).min()
        assert distance(a, b)[k] == pytest.approx(brute, abs=0.02)
        assert distance(a, b)[k] <= brute + 1e-9


def test_a_robot_without_an_outline_has_rods(tmp_path):
    file = arms.write_robot(tmp_path, arms.Arm())
    robot = load_robot(file)
    body = RigidBody(robot.urdf, tuple(joint.name for joint in robot.joints))
    assert [capsule.link for capsule in read_outline(file, body).capsules] == [0, 1, 2, 3, 4, 5]
    file.write_text(file.read_text() + "capsules: [{link: 9, from: [0, 0, 0], to: [0, 0, 1], radius: 0.1}]\n")
    with pytest.raises(ConfigError, match="a link above 6"):
        read_outline(file, body)


def test_gaps_are_distances_between_the_rods_and_to_the_floor(planar):
    post = Capsule(link=0, start=(1.0, -0.3, 0.2), end=(1.0, 0.3, 0.2), radius=0.05)
    lower = Capsule(link=2, start=(0, 0, 0), end=(0.6, 0, 0), radius=0.04)
    checker = Checker(planar, Outline(floor=-1.0, capsules=(post, lower)), WIDE)
    raised = np.array([0.0, -np.arctan2(0.2, 1.0 - L1)])
    gaps = checker.gaps(np.array([[0.0, 0.0], [0.0, np.pi / 2], raised]))
    expected = [[0.2, 1.0], [np.hypot(1.0 - L1, 0.2), 0.4], [0.0, 1.0]]
    np.testing.assert_allclose(gaps, np.array(expected) - [0.09, 0.04], atol=1e-9)
    np.testing.assert_array_equal(checker.safe(np.array([[0.0, 0.0], raised])), [True, False])


def test_poses_closer_than_the_clearance_are_not_safe(planar):
    lower = Capsule(link=2, start=(0, 0, 0), end=(0.5, 0, 0), radius=0.05)
    for floor, safe in ((-0.05 - CLEARANCE - 1e-6, True), (-0.05 - CLEARANCE + 1e-6, False)):
        checker = Checker(planar, Outline(floor=floor, capsules=(lower,)), WIDE)
        assert checker.safe(np.zeros((1, 2))).tolist() == [safe]


def test_pairs_that_touch_in_the_middle_of_all_ranges_are_left_out(planar):
    post = Capsule(link=0, start=(1.0, 0, -0.3), end=(1.0, 0, 0.3), radius=0.05)
    lower = Capsule(link=2, start=(0, 0, 0), end=(0.5, 0, 0), radius=0.04)
    outline = Outline(floor=-5.0, capsules=(post, lower))
    assert Checker(planar, outline, WIDE).gaps(np.zeros((1, 2))).shape == (1, 1)
    aside = np.array([[1.0, 2.0], [0.0, 1.0]])
    assert Checker(planar, outline, aside).gaps(np.zeros((1, 2))).shape == (1, 2)


def test_wrong_capsules_are_told(planar, tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text("capsules:\n- {link: 4, from: [0, 0, 0], to: [0, 0, 1], radius: 0.1}\n")
    with pytest.raises(ConfigError, match="a link above 2, the last"):
        read_outline(tmp_path, planar)
    file.write_text("capsules:\n- {link: 1, from: [0, 0, 0], to: [0, 0, 1], radius: -1}\n")
    with pytest.raises(ConfigError, match=r"capsules\.0\.radius"):
        read_outline(file, planar)
