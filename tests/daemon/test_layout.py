"""Columns of the frames by name."""

from __future__ import annotations

import pytest

from cellwatt import ConfigError, FrameChannel, Layout


def layout_of(*names: str) -> Layout:
    return Layout(tuple(FrameChannel(name, "rad", "continuous", "linear") for name in names), 50.0)


def test_joints_are_those_of_the_source_that_has_the_first_one() -> None:
    """A gantry has a seventh joint and no first one."""
    both = layout_of("arm.joint_1.position", "gantry.joint_7.position", "arm.joint_2.position", "arm.joint_1.torque")
    assert both.joints("position") == both.joints("position", "arm") == (0, 2)
    with pytest.raises(ConfigError, match=r"source 'gantry' has no joint_1\.position; these have: arm"):
        both.joints("position", "gantry")
    with pytest.raises(ConfigError, match=r"no source has joint_1\.position"):
        layout_of("gantry.joint_7.position").joints("position")
    with pytest.raises(ConfigError, match="several sources have joints: choose one of left, right"):
        layout_of("left.joint_1.position", "right.joint_1.position").joints("position")
