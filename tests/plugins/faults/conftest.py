import pytest

from tests.plugins.faults.plant import OTHER, Cycle, frames, run
from tests.plugins.faults.watching import learned


@pytest.fixture(scope="session")
def reference(tmp_path_factory):
    """Healthy running of the plant at full speed."""
    positions, power, _ = run([Cycle()] * 8, seed=50)
    return learned(tmp_path_factory.mktemp("reference") / "reference.yaml", frames(positions, power))


@pytest.fixture(scope="session")
def rich_reference(tmp_path_factory):
    """Two tasks, one of them at two speeds."""
    cycles = [Cycle()] * 4 + [Cycle(speed=0.6)] * 4 + [Cycle(OTHER)] * 4 + [Cycle()] * 2
    positions, power, _ = run(cycles, seed=51)
    return learned(tmp_path_factory.mktemp("rich") / "rich.yaml", frames(positions, power))
