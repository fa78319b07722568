"""A simulation that another program streams: it is what the arm is held to, whatever robot.yaml says."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt.results import Alarm, Prediction
from tests.blocks import layout_of
from tests.plugins.explain.emulated_arm import CHANNELS, JOINTS, framed, frames, recorded
from tests.plugins.explain.test_stage import made, run


def beside(arm, twin, without=()):
    """Frames of an arm and of the program that simulates it."""
    units = {f"twin.joint_{j}.torque": "Nm" for j in range(1, JOINTS + 1)} | {"twin.supply.power": "W"}
    said = dict(zip(units, [*twin.torque.T, twin.power], strict=True))
    kept = {name: unit for name, unit in units.items() if name not in without}
    return framed(layout_of(CHANNELS | kept), np.column_stack([frames(arm).values, *(said[name] for name in kept)]))


def told(robot, block, **settings):
    return run(made(robot, block.layout, simulation="twin", arm="arm", power="meter.supply.power", **settings), block)


def test_an_arm_that_does_what_the_twin_says_is_left_alone(robot):
    """Robot.yaml knows nothing of 30 Nm s/rad of friction, the twin does."""
    arm = recorded(24, viscous=30.0)
    results = told(robot, beside(arm, recorded(24, viscous=30.0, seed=5)))
    assert [r for r in results if isinstance(r, Alarm)] == []
    assert any(isinstance(r, Prediction) for r in results)


def test_what_the_twin_leaves_out_raises_the_alarm(robot):
    arm = recorded(30, viscous=30.0)
    alarms = [r for r in told(robot, beside(arm, recorded(30, seed=5))) if isinstance(r, Alarm)]
    assert [(a.joint, a.active) for a in alarms if a.joint is not None] == [(2, True)]


def test_a_twin_without_a_torque_is_refused(robot):
    block = beside(recorded(4), recorded(4), without=("twin.joint_3.torque",))
    with pytest.raises(ConfigError, match=r"twin must stream the simulation, but gives no twin\.joint_3\.torque"):
        told(robot, block)
