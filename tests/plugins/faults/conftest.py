import pytest

from tests.plugins.faults.plant import OTHER, Cycle, recorded
from tests.plugins.faults.watching import learned


@pytest.fixture(scope="session")
def reference(tmp_path_factory):
    """Healthy running of the plant at full speed."""
    return learned(tmp_path_factory.mktemp("reference") / "reference.yaml", recorded([Cycle()] * 8, seed=50))


@pytest.fixture(scope="session")
def rich_reference(tmp_path_factory):
    """Two tasks, one of them at two speeds."""
    cycles = [Cycle()] * 4 + [Cycle(speed=0.6)] * 4 + [Cycle(OTHER)] * 4 + [Cycle()] * 2
    return learned(tmp_path_factory.mktemp("rich") / "rich.yaml", recorded(cycles, seed=51))
