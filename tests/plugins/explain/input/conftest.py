from pathlib import Path

import pytest

from cellwatt_plugins.robot import Arm
from tests.plugins.explain.recorded_arm import write_robot


@pytest.fixture(scope="package")
def described(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The arm's ``robot.yaml``; nobody writes beside it."""
    return write_robot(tmp_path_factory.mktemp("described"))


@pytest.fixture(scope="package")
def arm(described: Path) -> Arm:
    """The arm as its description has it."""
    return Arm.load(described)
