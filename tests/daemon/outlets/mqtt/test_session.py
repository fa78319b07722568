"""A session without a broker."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import pytest

from cellwatt.account import Account
from cellwatt.outlets.mqtt import session as module
from cellwatt.outlets.mqtt.session import Session
from cellwatt.outlets.mqtt.settings import MqttSettings
from tests.patience import eventually


async def test_rebirths_that_are_asked_for_in_a_row_are_merged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BIRTH_EVERY", 0.2)
    settings, account = MqttSettings.model_validate({}), Account()
    outbox = SimpleNamespace(wake=asyncio.Event(), leave=lambda: None)
    parts = cast("Any", (SimpleNamespace(), SimpleNamespace(ready=False), outbox, None))
    monkeypatch.setattr(module, "Sending", lambda _: SimpleNamespace(end=_nothing))
    session = Session(settings, parts, None, "weld-3", account)
    for _ in range(2):
        for _ in range(250):
            session._ask_birth()
        assert not session._birth_due
        await eventually(lambda: session._birth_due)
        session._birth_due = False  # as once it is sent
    assert account.counters["rebirths merged"] == 498
    await session.end()


async def _nothing() -> None:
    pass
