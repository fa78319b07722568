from pathlib import Path

import pytest

from cellwatt_plugins.robot import Arm
from tests.plugins.explain import plant, recorded_arm


@pytest.fixture(scope="package")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The plant's arm as its description has it."""
    return plant.load(plant.write_robot(tmp_path_factory.mktemp("plant")))


@pytest.fixture(scope="package")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the description of an arm without viscous friction, as ``emulated_arm`` is."""
    return recorded_arm.write_robot(tmp_path_factory.mktemp("robot"), viscous_friction=0.0).parent
