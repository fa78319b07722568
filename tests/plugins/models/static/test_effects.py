"""The physics of held poses, against plain vector mechanics and against differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.models.static.identify import HeldArm
from cellwatt_plugins.models.static.poses import Poses
from cellwatt_plugins.robot import Arm
from tests.plugins.models.static import arms


def some_poses(seed=0, count=25, payload=None) -> Poses:
    rng = np.random.default_rng(seed)
    q, came = (arms.within(arms.LIMITS, rng.random((count, 6))) for _ in range(2))
    return Poses(q, np.zeros((count, 6)), q - came, np.full(count, np.nan) if payload is None else payload)


@pytest.fixture(scope="module")
def setting(tmp_path_factory):
    poses = some_poses(payload=np.random.default_rng(1).uniform(0, 5, 25))
    arm = HeldArm.of(Arm.load(arms.write_robot(tmp_path_factory.mktemp("robot"), arms.Arm())), poses.q)
    return poses, arm.basis(poses), arm.effects(poses)


def test_slopes_are_those_of_differences(setting):
    _, basis, effects = setting
    rng = np.random.default_rng(2)
    p = effects.scale * rng.normal(size=len(effects.scale))
    _, slopes = effects.evaluate(basis, p)
    for k in range(len(p)):
        step = np.zeros(len(p))
        step[k] = 1e-6 * effects.scale[k]
        up, down = (effects.evaluate(basis, p + s)[0] for s in (step, -step))
        np.testing.assert_allclose(slopes[..., k] * effects.scale[k], (up - down) / 2e-6, rtol=1e-4, atol=1e-4)


def at(effects, **groups):
    p = np.zeros(len(effects.scale))
    for name, value in groups.items():
        p[effects.slices[name.replace("_", " ")]] = value
    return p


MOMENT = arms.MASS[:, None] * arms.CENTRE
HEAVIER = arms.MASS + np.array([0, 0, 1.0, 0, 0, 0])
GAIN = np.array([0.1, -0.05, 0.02, 0, 0, 0.3])
REALLY = {
    "masses": (
        {"link_3": [1.0, 0.2, 0.0, -0.1]},
        arms.Arm(mass=HEAVIER, centre=(MOMENT + np.outer([0, 0, 1.0, 0, 0, 0], [0.2, 0, -0.1])) / HEAVIER[:, None]),
    ),
    "gain": ({"gain": GAIN}, arms.Arm(gain=1 + GAIN)),
    "tilt": ({"tilt": [2e-4, -1e-4]}, arms.Arm(tilt=(2e-4, -1e-4))),
    "zero": ({"zero": 1e-4 * np.arange(6)}, arms.Arm(zero=1e-4 * np.arange(6))),
    "friction": (
        {"friction_2": [5.0], "load_friction": [0.03, 0, 0, 0.01, 0, 0, 0]},
        arms.Arm(friction=np.array([0, 5.0, 0, 0, 0, 0]), load_friction=np.array([3, 3, 4, 3, 3, 3]) / 100),
    ),
}


@pytest.mark.parametrize("what", REALLY)
def test_an_effect_is_what_plain_mechanics_say(setting, what):
    poses, basis, effects = setting
    groups, really = REALLY[what]
    torque, _ = effects.evaluate(replace(basis, payload=np.zeros(len(basis))), at(effects, **groups))
    np.testing.assert_allclose(torque, really.torque(poses.q, poses.q - poses.approach), atol=2e-5)
