import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"
sys.path.append(str(BENCH))
pytest.importorskip("mujoco", reason="the arms are MuJoCo files")


@pytest.fixture(scope="session")
def bench() -> Path:
    return BENCH
