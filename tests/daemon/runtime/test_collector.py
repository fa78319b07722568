"""What is done before devices are read."""

from __future__ import annotations

import sys

import pytest

from cellwatt.runtime.collector import load_libraries
from tests.daemon.runtime.fakes import FakeDriver, config_of, sources


def test_libraries_of_drivers_are_loaded_and_missing_ones_left_to_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeDriver, "libraries", ("not_there.at_all", "wave"), raising=False)
    monkeypatch.delitem(sys.modules, "wave", raising=False)
    load_libraries(config_of(sources=sources("arm")))
    assert "wave" in sys.modules
