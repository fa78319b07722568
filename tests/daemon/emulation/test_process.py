"""Questions to an emulator's process, and its answers."""

from __future__ import annotations

import asyncio
from unittest.mock import AsyncMock, Mock

import pytest

from cellwatt.emulation import EmulatorProcess


async def test_the_answer_to_a_question_that_was_cancelled_is_not_the_next_ones() -> None:
    child = EmulatorProcess("ur")
    answers = asyncio.StreamReader()
    child._child = Mock(stdin=Mock(drain=AsyncMock()), stdout=answers)
    asked = asyncio.create_task(child.counts())
    await asyncio.sleep(0)
    asked.cancel()
    with pytest.raises(asyncio.CancelledError):
        await asked
    answers.feed_data(b'{"counts": {"sent": 1}}\n{"kept": 2.5}\n')
    assert await child.kept() == 2.5
