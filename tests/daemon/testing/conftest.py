from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint, EntryPoints, entry_points

import pytest

from cellwatt.testing.skeleton import SkeletonDriver
from tests.daemon.conftest import Registered


@pytest.fixture
def register(registered: Registered) -> Callable[[type[SkeletonDriver]], None]:
    """Makes a driver class the installed driver ``skeleton``."""

    def only(driver: type[SkeletonDriver]) -> None:
        point = EntryPoint("skeleton", f"{driver.__module__}:{driver.__name__}", "cellwatt.drivers")
        registered(lambda group: EntryPoints([point]) if group == point.group else entry_points(group=group))

    return only
