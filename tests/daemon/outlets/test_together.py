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
