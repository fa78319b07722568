"""A stop: sources first, then what is queued, then outlets and record; and nobody can hold it up for ever."""

from __future__ import annotations

import asyncio

import pytest

from cellwatt import SourceError
from cellwatt.runtime.tasks import end_of
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import RECEIVERS, FakeDriver, FakeOutlet, config_of, running


@pytest.mark.parametrize(("part", "name"), [(FakeOutlet, "outlet bus"), (FakeDriver, "source arm")])
@at_once
async def test_what_does_not_let_go_is_cut_off(monkeypatch, caplog, part, name):
    async def stays(self):
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.Event().wait()

    monkeypatch.setattr(part, "run", stays)
    async with asyncio.timeout(60):
        async with running(config_of()):
            pass
    assert RECEIVERS["bus"].health, "the rest is ended in order"
    assert f"{name} did not end within 5 s" in caplog.text


@pytest.mark.parametrize("error", [SourceError("gone"), KeyError("closing"), None])
async def test_what_is_stopped_ends_although_it_breaks_while_it_lets_go(caplog, error):
    begun = asyncio.Event()

    async def breaks():
        begun.set()
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            if error is not None:
                raise error from None

    task = asyncio.create_task(end_of(breaks, SourceError, "arm: the driver failed"))
    await begun.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):  # else the source would be connected again
        await task
    assert ("arm: the driver failed" in caplog.text) == isinstance(error, KeyError)
