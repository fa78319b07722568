from __future__ import annotations

import asyncio
import threading

import pytest

from cellwatt.outlets.zenoh.mailbox import Mailbox
from tests.patience import PATIENCE


def test_an_error_comes_after_what_is_left() -> None:
    box: Mailbox[int] = Mailbox(2)
    box.put(1)
    box.end(ValueError("broken"))
    box.end()
    assert box.take() == 1
    with pytest.raises(ValueError, match="broken"):
        box.take()


async def test_an_event_loop_takes_what_a_thread_puts() -> None:
    box: Mailbox[int] = Mailbox(10)
    putter = threading.Thread(target=lambda: [box.put(i) for i in range(5000)])
    putter.start()
    assert [await box.take_async() for _ in range(5000)] == list(range(5000))
    putter.join(PATIENCE)


async def test_a_cancelled_take_loses_nothing() -> None:
    box: Mailbox[int] = Mailbox(10)
    waiting = asyncio.create_task(box.take_async())
    await asyncio.sleep(0)
    waiting.cancel()
    box.put(1)
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert await box.take_async() == 1


async def test_several_takers_share() -> None:
    box: Mailbox[int] = Mailbox(10)
    takers = [asyncio.create_task(box.take_async()) for _ in range(4)]
    await asyncio.sleep(0)
    threading.Thread(target=lambda: [box.put(i) for i in range(3)]).start()
    done, (left,) = await asyncio.wait(takers, timeout=0.5)
    assert sorted(t.result() for t in done) == [0, 1, 2]
    box.end()
    assert await left is None


def test_a_loop_that_was_closed_does_not_break_the_putter() -> None:
    box: Mailbox[int] = Mailbox(10)

    async def wait_a_little() -> None:
        waiting = asyncio.create_task(box.take_async())
        await asyncio.sleep(0)
        waiting.cancel()

    asyncio.run(wait_a_little())
    box.put(1)
    assert box.take() == 1
