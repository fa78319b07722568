"""The runtime is tested with parts that do what a test tells them."""

from __future__ import annotations

import random

import pytest

from tests.daemon.conftest import Registered
from tests.daemon.runtime import fakes, one_process


@pytest.fixture(autouse=True)
def _fake_parts(registered: Registered) -> None:
    registered(fakes.entry_points)
    for parts in (fakes.DEVICES, fakes.JUDGES, fakes.RECEIVERS):
        parts.clear()


@pytest.fixture(autouse=True)
def _quick_health(monkeypatch: pytest.MonkeyPatch) -> None:
    """Health is looked at every 2 ms instead of every second."""
    monkeypatch.setattr(one_process, "HEALTH_RATE", 500.0)


@pytest.fixture
def no_jitter(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pauses are in the middle of their spread."""
    monkeypatch.setattr(random, "random", lambda: 0.5)
