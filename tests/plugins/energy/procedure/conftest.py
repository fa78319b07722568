import numpy as np
import pytest

from cellwatt_plugins.robot import Arm

SPEEDS = (200.0, 250.0)


@pytest.fixture(scope="package")
def plant():
    """An emulated UR5e on its cube."""
    from tests.plugins.energy.procedure.plant import UR5E, Arm

    return Arm(UR5E)


@pytest.fixture(scope="package")
def arm(plant, tmp_path_factory):
    """The arm as its user knows it."""
    return Arm.load(plant.describe(tmp_path_factory.mktemp("robot")))


@pytest.fixture(scope="package")
def programme(plant):
    """Two speeds, three repetitions each, no payload: rows (N, 18) and power (N,) at 500 Hz."""
    return plant.programme(0.0, SPEEDS, 3, np.random.default_rng(5))
