from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.daemon.outlets.mqtt.broker import Broker


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    found = Broker(tmp_path)
    found.start()
    yield found
    found.kill()


@pytest.fixture(autouse=True)
def _nothing_fails_aside(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """No callback and no task fails where only the log tells."""
    yield
    assert [r.getMessage() for r in caplog.get_records("call") if r.name == "asyncio" and r.levelname == "ERROR"] == []
