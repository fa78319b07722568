"""Robots that come with the project, held against what others publish of them.

The forward kinematics here are those of M. Brandstötter, A. Angerer, M. Hofbaur: An Analytical Solution of the Inverse
Kinematics Problem of Industrial Serial Manipulators with an Ortho-parallel Basis and a Spherical Wrist (2014), eqs. (1)
to (6); their parameters are each robot's in ROS-Industrial's packages.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from cellwatt_plugins.robot import Arm, load_robot
from cellwatt_plugins.robot.description import PACKAGED as FOLDER

PACKAGED = sorted(FOLDER.rglob("robot.yaml"))


@dataclass(frozen=True)
class Published:
    """Distances in m, offsets and signs of the angles; mechanical limits and masses as they are published."""

    a1: float
    a2: float
    b: float
    c1: float
    c2: float
    c3: float
    c4: float
    offsets: tuple[float, ...]
    signs: tuple[int, ...]
    limits: tuple[tuple[float, float], ...]
    speeds: tuple[float, ...]
    masses: tuple[float, ...]


PUBLISHED = {
    # motoman_mh12_support: config/opw_parameters_mh12.yaml; urdf/mh12_macro.xacro. Limits and masses: the paper
    # "A Hybrid Energy Consumption Model …", Tables II and I, which are what the file says it takes.
    "mh12": Published(
        a1=0.155, a2=-0.200, b=0.0, c1=0.450, c2=0.614, c3=0.640, c4=0.100,
        offsets=(0, 0, -np.pi / 2, 0, 0, np.pi), signs=(1, 1, -1, -1, -1, -1),
        limits=((-2.967, 2.967), (-1.5708, 2.7052), (-1.4835, 2.6179), (-3.4906, 3.4096), (-2.6179, 2.6179),
                (-3.1415, 3.1415)),
        speeds=(3.8397, 3.4906, 3.8397, 7.1558, 7.1558, 10.6465), masses=(44.652, 30.939, 10.538, 4.9476, 2.0965),
    ),
}  # fmt: skip


def flange(arm: Published, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position, m, of the flange: z points out of it."""
    q = joints * arm.signs - arm.offsets
    s, c = np.sin(q), np.cos(q)
    psi, k = np.arctan2(arm.a2, arm.c3), np.hypot(arm.a2, arm.c3)
    out = arm.c2 * s[1] + k * np.sin(q[1] + q[2] + psi) + arm.a1
    up = arm.c2 * c[1] + k * np.cos(q[1] + q[2] + psi)
    wrist = np.array([out * c[0] - arm.b * s[0], out * s[0] + arm.b * c[0], up + arm.c1])
    s23, c23 = np.sin(q[1] + q[2]), np.cos(q[1] + q[2])
    arm_turn = np.array([[c[0] * c23, -s[0], c[0] * s23], [s[0] * c23, c[0], s[0] * s23], [-s23, 0, c23]])
    hand_turn = np.array(
        [
            [c[3] * c[4] * c[5] - s[3] * s[5], -c[3] * c[4] * s[5] - s[3] * c[5], c[3] * s[4]],
            [s[3] * c[4] * c[5] + c[3] * s[5], -s[3] * c[4] * s[5] + c[3] * c[5], s[3] * s[4]],
            [-s[4] * c[5], s[4] * s[5], c[4]],
        ]
    )
    turn = arm_turn @ hand_turn
    return turn, wrist + arm.c4 * turn[:, 2]


def test_every_packaged_robot_has_published_figures() -> None:
    assert {load_robot(file).robot for file in PACKAGED} == set(PUBLISHED)


@pytest.mark.parametrize("file", PACKAGED, ids=lambda file: file.parent.name)
def test_the_flange_is_where_the_published_parameters_put_it(file: Path) -> None:
    described = Arm.load(file)
    arm = PUBLISHED[described.name]
    low, high = np.array(arm.limits).T
    poses = np.vstack([np.zeros(6), low + (high - low) * np.random.default_rng(1).random((200, 6))])
    frames = described.forward(poses)[:, -1]
    zero = flange(arm, poses[0])[0].T @ frames[0, :3, :3]
    for q, frame in zip(poses, frames, strict=True):
        turn, place = flange(arm, q)
        np.testing.assert_allclose(frame[:3, 3], place, atol=1e-6)
        np.testing.assert_allclose(frame[:3, :3], turn @ zero, atol=1e-6)


@pytest.mark.parametrize("file", PACKAGED, ids=lambda file: file.parent.name)
def test_limits_speeds_and_masses_are_those_published(file: Path) -> None:
    robot = load_robot(file)
    arm = PUBLISHED[robot.robot]
    tree = ElementTree.parse(robot.urdf)
    limits = [{k: float(v) for k, v in limit.attrib.items()} for limit in tree.iter("limit")]
    assert [(limit["lower"], limit["upper"]) for limit in limits] == list(arm.limits)
    assert [limit["velocity"] for limit in limits] == pytest.approx(arm.speeds, abs=2e-4)
    assert [float(mass.attrib["value"]) for mass in tree.iter("mass")] == list(arm.masses)
    for joint, (low, high) in zip(robot.joints, arm.limits, strict=True):
        assert low <= joint.lower_limit < joint.upper_limit <= high
