"""A robot.yaml from plain values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml


def write_description(
    folder: Path,
    content: Mapping[str, object],
    joints: Sequence[Mapping[str, object]],
    changes: Mapping[str, object],
) -> Path:
    """Write ``robot.yaml``; ``changes`` apply to every joint that has the key, others to the robot."""
    for_joints = {key: value for key, value in changes.items() if key in joints[0]}
    for_robot = {key: value for key, value in changes.items() if key not in joints[0]}
    text = yaml.safe_dump({**content, **for_robot, "joints": [{**joint, **for_joints} for joint in joints]})
    (folder / "robot.yaml").write_text(text)
    return folder / "robot.yaml"
