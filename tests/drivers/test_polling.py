"""Connections that are opened one after the other."""

from __future__ import annotations

import asyncio
import time
from unittest.mock import AsyncMock, Mock

import pytest

from cellwatt.errors import DeviceError, ProtocolError
from cellwatt_drivers.shared.polling import _SHORTEST, keep_conversing

from .inlet import CollectingInlet


async def test_a_device_that_fails_at_once_is_not_flooded_with_connections(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = Mock(inlet=CollectingInlet())
    ends = iter([ProtocolError("garbled"), ProtocolError("garbled"), DeviceError("refused")])

    async def converse() -> None:
        driver.inlet.account.expect()
        raise next(ends)

    pauses = AsyncMock()
    monkeypatch.setattr(time, "monotonic", lambda: 5.0)
    monkeypatch.setattr(asyncio, "sleep", pauses)
    with pytest.raises(DeviceError):
        await keep_conversing(driver, converse)
    assert [call.args for call in pauses.await_args_list] == [(_SHORTEST,), (_SHORTEST,)]
