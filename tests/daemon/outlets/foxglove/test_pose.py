"""Joints of an arm against SciPy."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cellwatt.outlets.foxglove.arm import moved, of_rpy
from tests.daemon.outlets.foxglove.moving import skeleton

ANGLE = st.floats(-10, 10)
VECTOR = st.tuples(*[st.floats(-5, 5).map(lambda v: round(v, 6))] * 3)


def same(found: Any, truth: Rotation) -> bool:
    return bool(np.allclose(Rotation.from_quat(found).as_matrix(), truth.as_matrix(), atol=1e-12))


@given(VECTOR, VECTOR.filter(lambda v: math.hypot(*v) > 1e-3), ANGLE)
def test_joints(rpy: Any, axis: Any, value: float) -> None:
    assert same(of_rpy(rpy), Rotation.from_euler("xyz", rpy))
    unit = np.array(axis) / np.linalg.norm(axis)
    moves = {
        "revolute": (np.zeros(3), Rotation.from_rotvec(unit * value)),
        "prismatic": (unit * value, Rotation.identity()),
    }
    for kind, (place, rotation) in moves.items():
        found = moved({"channel": "a", "type": kind, "axis": unit.tolist()}, {"a": value})
        assert found is not None
        np.testing.assert_allclose(found[0], place, atol=1e-12)
        assert same(found[1], rotation)


def test_a_joint_that_is_not_known_is_left_where_it_was() -> None:
    told = skeleton()["joints"]
    told[4]["channel"] = None
    values = {f"arm.joint_{i}.position": 0.1 for i in (1, 2, 4)} | {"arm.joint_3.position": math.nan}
    assert [moved(joint, values) is not None for joint in told] == [True, True, False, True, True, False]


def test_a_joint_that_follows_another_moves_as_its_urdf_says() -> None:
    joint = skeleton()["joints"][5]
    follows = {**joint, "multiplier": -2.0, "offset": 0.5}
    found, expected = moved(follows, {joint["channel"]: 0.3}), moved(joint, {joint["channel"]: -0.1})
    assert found is not None and expected is not None
    assert found[1] == pytest.approx(expected[1])
