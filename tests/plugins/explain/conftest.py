import pytest

from cellwatt_plugins.robot import Arm
from tests.plugins.explain import plant


@pytest.fixture(scope="package")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The plant's arm as its description has it."""
    return plant.load(plant.write_robot(tmp_path_factory.mktemp("plant")))
