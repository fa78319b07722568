import numpy as np
import pytest

from cellwatt_plugins.energy.drive import Drive, chopper_power, features, supply_power
from cellwatt_plugins.robot import Arm


def drive(returned):
    return Drive(90.0, np.array([0.9]), np.array([1.1]), np.array([0.4]), np.array([0.2]), np.array([0.5]), returned)


def test_energy_is_kept():
    """Supply + nothing = fixed + bus + chopper, at any sign."""
    bus = np.linspace(-50, 50, 11)
    assert supply_power(drive(0.3), bus) == pytest.approx(90 + bus + chopper_power(drive(0.3), bus))


def test_a_joint_that_stands_loses_nothing_by_hysteresis_whatever_its_encoder_says(measured):
    arm = Arm.load(measured[1])
    noise, moving = np.full((1, arm.joints), 2e-3), np.full((1, arm.joints), -0.3)
    assert not features(arm, 0 * noise, noise)[:, -arm.joints :].any()
    assert features(arm, 0 * moving, moving)[0, -arm.joints :] == pytest.approx(0.3)
