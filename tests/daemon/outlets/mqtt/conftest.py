from __future__ import annotations

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from tests.daemon.outlets.mqtt.broker import Broker, started


@pytest.fixture
async def broker(tmp_path: Path) -> AsyncIterator[Broker]:
    async with started(tmp_path) as found:
        yield found


@pytest.fixture(autouse=True)
def _nothing_fails_aside(caplog: pytest.LogCaptureFixture) -> Iterator[None]:
    """No callback and no task fails where only the log tells."""
    yield
    assert [r.getMessage() for r in caplog.get_records("call") if r.name == "asyncio" and r.levelname == "ERROR"] == []
