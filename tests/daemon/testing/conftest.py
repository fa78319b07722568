from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint, EntryPoints, entry_points

import pytest

from cellwatt import registry
from cellwatt.testing.skeleton import SkeletonDriver


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[type[SkeletonDriver]], None]]:
    """Makes a driver class the installed driver ``skeleton``."""

    def only(driver: type[SkeletonDriver]) -> None:
        point = EntryPoint("skeleton", f"{driver.__module__}:{driver.__name__}", "cellwatt.drivers")
        monkeypatch.setattr(
            registry,
            "entry_points",
            lambda group: EntryPoints([point]) if group == point.group else entry_points(group=group),
        )
        registry.available.cache_clear()

    yield only
    registry.available.cache_clear()
