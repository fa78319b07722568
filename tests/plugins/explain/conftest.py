from pathlib import Path

import numpy as np
import pytest

from cellwatt_plugins.robot import Arm
from tests.plugins.explain import plant, recorded_arm


@pytest.fixture(scope="package")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The plant's arm as its description has it."""
    return plant.load(plant.write_robot(tmp_path_factory.mktemp("plant")))


@pytest.fixture(scope="package")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the robot and three runs whose third joint reads 1.5 Nm too much, and their simulations."""
    folder = tmp_path_factory.mktemp("cell")
    plant.write_robot(folder)
    for seed in (1, 2, 3):
        offset = plant.Missing(read=lambda torque: torque + np.array([0, 0, 1.5]))
        plant.write(folder, plant.record(f"run_{seed:02d}", seed, offset, 8.0))
    return folder


@pytest.fixture(scope="package")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the description of an arm without viscous friction, as ``emulated_arm`` is."""
    return recorded_arm.write_robot(tmp_path_factory.mktemp("robot"), viscous_friction=0.0).parent
