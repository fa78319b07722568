from pathlib import Path

import pytest


@pytest.fixture
def bench(monkeypatch):
    """The packages of the benchmarks can be imported."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "bench"))
