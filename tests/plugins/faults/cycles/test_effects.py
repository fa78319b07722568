import numpy as np
import pytest

from cellwatt_plugins.faults.cycles.arm import Motion
from cellwatt_plugins.faults.cycles.effects import joint_effects
from cellwatt_plugins.faults.cycles.load import load_of
from tests.plugins.faults.cycles.four_joints import CONSTANT, RATE, RESISTANCE, links, move

POSE = np.array([0.2, 0.9, 0.4, 0.1])


def test_a_joint_at_rest_may_lack_the_power_that_holds_it(known):
    """The first joint moves, the second rests."""
    path = move(POSE, POSE + np.array([0.8, 0.0, 0.0, 0.0]), 1.2)
    rate = np.gradient(path, 1 / RATE, axis=0)
    motion = Motion(path, rate, np.gradient(rate, 1 / RATE, axis=0))
    load = load_of(known.arm.body, known.arm.parameters, motion)
    (effect,) = (effect for effect in joint_effects(known.arm, load, 1) if effect.what == "unheld")
    held = links(np.repeat(POSE[None], 9, axis=0), np.zeros(9))[4, 1]
    heat = RESISTANCE[1] * (held / CONSTANT[1]) ** 2
    assert heat > 0.5
    assert effect.columns[-1, 0] == pytest.approx(-heat, rel=0.25)
