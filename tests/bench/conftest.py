"""The benchmarks are imported from their folder."""

import sys
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[2] / "bench"
sys.path.append(str(BENCH))


@pytest.fixture(scope="session")
def bench() -> Path:
    return BENCH
