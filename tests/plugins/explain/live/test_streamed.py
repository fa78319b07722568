"""A simulation that another program streams: it is what the arm is held to, whatever robot.yaml says."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt.frames import FrameChannel, Layout
from cellwatt.results import Alarm, Prediction
from tests.plugins.explain.emulated_arm import JOINTS, framed, frames, layout, recorded
from tests.plugins.explain.test_stage import made, run


def beside(arm, twin, without=()):
    """Frames of an arm and of the program that simulates it."""
    lay = layout()
    channels = [FrameChannel(f"twin.joint_{j}.torque", "Nm", "continuous", "linear") for j in range(1, JOINTS + 1)]
    channels.append(FrameChannel("twin.supply.power", "W", "continuous", "average"))
    kept = [i for i, channel in enumerate(channels) if channel.name not in without]
    whole = Layout((*lay.channels, *(channels[i] for i in kept)), lay.rate)
    said = np.column_stack([twin.torque, twin.power])[:, kept]
    return framed(whole, np.column_stack([frames(arm, lay).values, said]))


def told(robot, block, **settings):
    return run(made(robot, block.layout, simulation="twin", arm="arm", power="meter.supply.power", **settings), block)


def test_an_arm_that_does_what_the_twin_says_is_left_alone(robot):
    """Robot.yaml knows nothing of 30 Nm s/rad of friction, the twin does."""
    arm = recorded(24, 50, viscous=30.0)
    results = told(robot, beside(arm, recorded(24, 50, viscous=30.0, seed=5)))
    assert [r for r in results if isinstance(r, Alarm)] == []
    assert any(isinstance(r, Prediction) for r in results)


def test_what_the_twin_leaves_out_raises_the_alarm(robot):
    arm = recorded(30, 50, viscous=30.0)
    alarms = [r for r in told(robot, beside(arm, recorded(30, 50, seed=5))) if isinstance(r, Alarm)]
    assert [(a.joint, a.active) for a in alarms if a.joint is not None] == [(2, True)]


def test_a_twin_without_a_torque_is_refused(robot):
    block = beside(recorded(4, 50), recorded(4, 50), without=("twin.joint_3.torque",))
    with pytest.raises(ConfigError, match=r"twin must stream the simulation, but gives no twin\.joint_3\.torque"):
        told(robot, block)
