"""A stop: sources first, then what is queued, then outlets and record; and nobody can hold it up for ever."""

from __future__ import annotations

import asyncio

from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    RECEIVERS,
    FakeDriver,
    FakeOutlet,
    config_of,
    running,
)


@at_once
async def test_a_outlet_that_never_drains_is_cut_off(monkeypatch, caplog):
    async def hangs(self):
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.Event().wait()

    monkeypatch.setattr(FakeOutlet, "run", hangs)
    async with asyncio.timeout(60):
        async with running(config_of()):
            pass
    assert "outlet bus did not end within 5 s" in caplog.text


@at_once
async def test_a_driver_that_does_not_let_go_is_cut_off(monkeypatch, caplog):
    async def stays(self):
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.Event().wait()

    monkeypatch.setattr(FakeDriver, "run", stays)
    async with asyncio.timeout(60):
        async with running(config_of()):
            pass
    assert RECEIVERS["bus"].health, "the rest is ended in order"
    assert "source arm did not end within 5 s" in caplog.text
