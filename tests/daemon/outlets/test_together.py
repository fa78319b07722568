"""Works that go on until one of them ends."""

from __future__ import annotations

import asyncio

import pytest

from cellwatt.outlets.together import until_one_ends


async def test_the_first_end_is_the_end_of_all() -> None:
    ended: list[str] = []

    async def goes_on() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            ended.append("the other")

    async def breaks() -> None:
        raise ValueError("broken")

    await until_one_ends(asyncio.sleep(0), goes_on())
    with pytest.raises(ValueError, match="broken"):
        await until_one_ends(goes_on(), breaks())
    assert ended == ["the other", "the other"]


async def test_a_stop_ends_all() -> None:
    begun = asyncio.Event()
    ended: list[bool] = []

    async def goes_on() -> None:
        begun.set()
        try:
            await asyncio.Event().wait()
        finally:
            ended.append(True)

    running = asyncio.create_task(until_one_ends(goes_on(), goes_on()))
    await begun.wait()
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert ended == [True, True]
