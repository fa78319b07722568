"""Joints against SciPy, and the packaged arm against SciPy's own chain of rotations."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from cellwatt.outlets.foxglove.arm import Vector, joint_pose, joints_of, poses
from tests.daemon.outlets.foxglove.moving import skeleton

ANGLE = st.floats(-10, 10)
VECTOR = st.tuples(*[st.floats(-5, 5).map(lambda v: round(v, 6))] * 3)
AXIS = VECTOR.filter(lambda v: math.hypot(*v) > 1e-3)


def same(found: Any, truth: Rotation) -> bool:
    return bool(np.allclose(Rotation.from_quat(found).as_matrix(), truth.as_matrix(), atol=1e-12))


@given(VECTOR, VECTOR, AXIS, ANGLE)
def test_joints(xyz: Vector, rpy: Vector, axis: Vector, value: float) -> None:
    fixed, unit = RigidTransform.from_components(xyz, Rotation.from_euler("xyz", rpy)), np.array(axis)
    unit /= np.linalg.norm(unit)
    moves = {
        "revolute": RigidTransform.from_rotation(Rotation.from_rotvec(unit * value)),
        "prismatic": RigidTransform.from_translation(unit * value),
        "fixed": RigidTransform.identity(),
    }
    for kind, move in moves.items():
        place, rotation = joint_pose(xyz, rpy, axis, kind, value)
        truth = fixed * move
        np.testing.assert_allclose(place, truth.translation, atol=1e-12)
        assert same(rotation, truth.rotation)


def test_a_joint_that_is_not_known_is_left_where_it_was() -> None:
    values = {f"arm.joint_{i}.position": 0.1 for i in range(1, 7)} | {"arm.joint_3.position": math.nan}
    told = skeleton()
    told["joints"][4]["channel"] = None
    del values["arm.joint_6.position"]
    assert [pose.frame[-1] for pose in poses(joints_of(told), values)] == ["1", "2", "4", "5"]


def test_a_joint_that_follows_another_moves_as_its_urdf_says() -> None:
    told = skeleton()
    told["joints"][5] |= {"channel": told["joints"][4]["channel"], "multiplier": -2.0, "offset": 0.5}
    values = {joint["channel"]: 0.3 for joint in told["joints"]}
    found = poses(joints_of(told), values)[5]
    joint = told["joints"][5]
    assert same(
        found.rotation, Rotation.from_quat(joint_pose(*(joint[k] for k in ("xyz", "rpy", "axis", "type")), -0.1)[1])
    )
