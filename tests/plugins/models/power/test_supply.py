"""The supply's numbers, found again from powers made by plain arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.models.power import supply as supplies
from cellwatt_plugins.models.power.supply import BRAKES
from cellwatt_plugins.robot import Joint, RobotDescription
from cellwatt_plugins.robot.drive import Drives

CONSTANT, RESISTANCE = np.array([12.0, 10.0, 8.0]), np.array([0.6, 0.8, 1.2])
JOINTS = tuple(Joint(name=f"joint_{i}", winding_resistance=r) for i, r in enumerate(RESISTANCE))
STATED = RobotDescription(robot="arm", urdf="arm.urdf", joints=JOINTS)
UNSTATED = RobotDescription(robot="arm", urdf="arm.urdf", joints=tuple(Joint(name=j.name) for j in JOINTS))
FOLD = np.repeat(np.arange(6), 500)


def driven(seed=0):
    draw = np.random.default_rng(seed)
    torque = draw.normal(size=(3000, 3)) * [40, 30, 10]
    qd = draw.normal(size=(3000, 3))
    qd[::7] = 0
    current = torque / CONSTANT
    return Drives(torque * qd, current**2 * RESISTANCE, qd, current), draw.normal(size=3000)


def fitted(drive, power):
    """Losses, sharing, the supply, and the rms of its residual, W."""
    effects, sharing = supplies.select(drive, power, FOLD, STATED)
    return effects, sharing, *supplies.fit(drive, power, supplies.believed(drive, power, effects, sharing, STATED))


def test_one_bus_that_burns_what_comes_back():
    drive, noise = driven()
    flow = (drive.mechanical + drive.copper).sum(axis=1)
    power = 80 + np.maximum(flow, 0) / 0.9 + 0.5 * noise
    *chosen, found, left = fitted(drive, power)
    assert tuple(chosen) == ((), "bus")
    assert found.standby == pytest.approx(80, abs=0.2)
    assert 1 / found.up == pytest.approx(0.9, rel=0.03)
    assert found.down == pytest.approx(0, abs=0.02)
    assert left == pytest.approx(0.5, rel=0.05)


def test_drives_that_each_burn_their_own_and_iron_loss():
    drive, noise = driven(1)
    each = drive.mechanical + drive.copper + 4 * np.abs(drive.qd)
    power = 50 + np.maximum(each, 0).sum(axis=1) / 0.85 + 0.5 * noise
    *chosen, found, left = fitted(drive, power)
    assert tuple(chosen) == (("iron loss",), "joint")
    assert left == pytest.approx(0.5, rel=0.05)
    assert found.weights[found.terms.index("hysteresis")] == pytest.approx(4, rel=0.1)


def test_energy_that_is_fed_back_and_brakes():
    drive, noise = driven(2)
    flow = (drive.mechanical + drive.copper).sum(axis=1)
    power = 60 + flow / 0.9 + 8 * (np.abs(drive.qd).max(axis=1) > 0) + 0.5 * noise
    *chosen, found, _ = fitted(drive, power)
    assert tuple(chosen) == ((BRAKES,), "bus")
    assert found.down / found.up == pytest.approx(1, abs=0.02)
    assert found.brakes == pytest.approx(8, abs=0.3)


def test_a_loss_that_a_joint_lacks_is_none_and_never_gives_power():
    drive, noise = driven(3)
    flow = (drive.mechanical + drive.copper * [1, 1, 0] + np.abs(drive.qd) * [4, 4, 0]).sum(axis=1)
    power = 80 + np.maximum(flow, 0) / 0.9 + 10 * noise
    found, _ = supplies.fit(drive, power, supplies.believed(drive, power, ("iron loss",), "bus", UNSTATED))
    copper, iron = (found.weights[found.terms.index(name)] for name in ("copper", "hysteresis"))
    assert found.weights.min() == 0
    assert copper == pytest.approx([1, 1, 0], abs=0.15)
    assert iron == pytest.approx([4, 4, 0], abs=1)
