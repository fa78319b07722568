"""The packaged arm by SciPy and its own file alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from tests.daemon.outlets.foxglove.cell import joints


def tool(angles: Sequence[float]) -> list[float]:
    """Place of the last joint from the base, m, for angles in rad."""
    whole = np.eye(4)
    for joint, angle in zip(joints(), angles, strict=True):
        step = np.eye(4)
        turn = Rotation.from_euler("xyz", joint["rpy"]) * Rotation.from_rotvec(np.array(joint["axis"]) * angle)
        step[:3, :3], step[:3, 3] = turn.as_matrix(), joint["xyz"]
        whole = whole @ step
    return list(whole[:3, 3])


def skeleton() -> dict[str, Any]:
    """The arm as the page's skeleton tells it."""
    told = [
        {**joint, "parent": i - 1, "type": "revolute", "channel": f"arm.joint_{i + 1}.position"}
        for i, joint in enumerate(joints())
    ]
    return {"source": "arm", "name": "mh12", "joints": told}


def place_of(found: Mapping[str, tuple[str, Any, Any]], frame: str, root: str) -> list[float]:
    """Place of a frame in ``root`` through frames' parents, places and rotations."""

    def within(frame: str) -> RigidTransform:
        if frame == root:
            return RigidTransform.identity()
        parent, place, rotation = found[frame]
        return within(parent) * RigidTransform.from_components(place, Rotation.from_quat(rotation))

    return list(within(frame).translation)


def tool_of(told: Any) -> list[float]:
    """Place of the arm's last joint in the world by a ``foxglove.FrameTransforms``."""
    found = {
        t.child_frame_id: (
            t.parent_frame_id,
            [t.translation.x, t.translation.y, t.translation.z],
            [t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w],
        )
        for t in told.transforms
    }
    children = {parent for parent, _, _ in found.values()}
    (last,) = [frame for frame in found if frame not in children and frame.startswith("arm/")]
    return place_of(found, last, "world")
