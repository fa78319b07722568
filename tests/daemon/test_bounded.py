import asyncio

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt.bounded import BoundedQueue, QueueClosedError
from tests.patience import PATIENCE


async def test_first_in_first_out():
    queue = BoundedQueue[int](10)
    for i in range(5):
        queue.put_nowait(i)
    assert len(queue) == queue.weight == 5
    assert [await queue.get() for _ in range(5)] == [0, 1, 2, 3, 4]
    assert len(queue) == queue.weight == 0


async def taken(queue, count):
    return [await queue.get() for _ in range(count)]


async def test_a_full_queue_that_blocks_refuses_put_nowait():
    queue = BoundedQueue[str](10)
    queue.put_nowait("a", weight=9)
    with pytest.raises(asyncio.QueueFull):
        queue.put_nowait("b", weight=2)
    queue.put_nowait("c", weight=1)
    assert await taken(queue, 2) == ["a", "c"]


async def test_put_waits_for_room():
    queue = BoundedQueue[int](2)
    order = []

    async def write():
        for i in range(6):
            await queue.put(i)
            order.append(i)

    writing = asyncio.create_task(write())
    await asyncio.sleep(0)
    assert order == [0, 1]
    assert len(queue) == 2
    assert [await queue.get() for _ in range(6)] == list(range(6))
    await writing


async def test_drop_oldest_hands_over_every_dropped_item():
    dropped = []
    queue = BoundedQueue[int](3, on_drop=dropped.append)
    for i in range(10):
        queue.put_nowait(i)
    assert dropped == [0, 1, 2, 3, 4, 5, 6]
    assert await taken(queue, 3) == [7, 8, 9]


async def test_drop_oldest_makes_room_for_a_heavy_item():
    dropped = []
    queue = BoundedQueue[str](10, on_drop=dropped.append)
    queue.put_nowait("light", weight=2)
    queue.put_nowait("heavy", weight=9)
    assert dropped == ["light"]
    assert queue.weight == 9


async def test_an_item_heavier_than_the_limit_is_taken_by_an_empty_queue():
    queue = BoundedQueue[str](10)
    await queue.put("huge", weight=25)
    with pytest.raises(asyncio.QueueFull):
        queue.put_nowait("small")
    assert await queue.get() == "huge"
    assert queue.weight == 0


async def test_get_waits_for_an_item():
    queue = BoundedQueue[int](3)
    getting = asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    queue.put_nowait(7)
    assert await getting == 7


async def test_close_lets_the_reader_drain_and_then_says_so():
    queue = BoundedQueue[int](3)
    queue.put_nowait(1)
    queue.put_nowait(2)
    queue.close()
    assert queue.closed
    with pytest.raises(QueueClosedError):
        queue.put_nowait(3)
    assert await queue.get() == 1
    assert await queue.get() == 2
    with pytest.raises(QueueClosedError):
        await queue.get()


async def test_close_wakes_who_waits():
    empty, full = BoundedQueue[int](1), BoundedQueue[int](1)
    full.put_nowait(0)
    waiting = [asyncio.create_task(w) for w in (empty.get(), empty.get(), full.put(1), full.put(2))]
    await asyncio.sleep(0)
    empty.close()
    full.close()
    outcomes = await asyncio.gather(*waiting, return_exceptions=True)
    assert [type(o) for o in outcomes] == [QueueClosedError] * 4
    assert await full.get() == 0


async def test_a_reader_cancelled_just_as_it_was_woken_loses_nothing():
    queue = BoundedQueue[int](3)
    first, second = asyncio.create_task(queue.get()), asyncio.create_task(queue.get())
    await asyncio.sleep(0)
    queue.put_nowait(1)  # wakes the first
    first.cancel()
    assert await asyncio.wait_for(second, PATIENCE) == 1
    assert first.cancelled()


async def test_a_writer_cancelled_just_as_it_was_woken_passes_its_turn_on():
    queue = BoundedQueue[int](1)
    queue.put_nowait(0)
    first, second = asyncio.create_task(queue.put(1)), asyncio.create_task(queue.put(2))
    await asyncio.sleep(0)
    assert await queue.get() == 0  # wakes the first
    first.cancel()
    await asyncio.wait_for(second, PATIENCE)
    assert await queue.get() == 2


async def test_several_blocked_writers_fill_the_room_that_reads_leave():
    queue = BoundedQueue[int](3)
    for i in range(3):
        queue.put_nowait(i)
    writers = [asyncio.create_task(queue.put(i)) for i in (3, 4, 5)]
    await asyncio.sleep(0)
    assert await taken(queue, 3) == [0, 1, 2]
    await asyncio.wait_for(asyncio.gather(*writers), PATIENCE)
    assert await taken(queue, 3) == [3, 4, 5]


def test_a_limit_below_one_is_refused():
    with pytest.raises(ValueError, match="at least 1"):
        BoundedQueue(0)


@settings(max_examples=50, deadline=None)
@given(
    items=st.lists(st.integers(1, 7), max_size=60),
    limit=st.integers(1, 10),
    drops=st.booleans(),
    actions=st.lists(st.sampled_from(["get", "cancel"]), max_size=40),
)
def test_what_goes_in_comes_out_or_is_handed_to_on_drop(items, limit, drops, actions):
    async def scenario():
        dropped, taken = [], []
        queue = BoundedQueue[tuple[int, int]](limit, dropped.append if drops else None)

        async def write():
            for pair in enumerate(items):
                await queue.put(pair, weight=pair[1])
                assert queue.weight <= limit or len(queue) == 1
                await asyncio.sleep(0)
            queue.close()

        async def read():
            for action in actions:
                if action == "cancel":
                    impatient = asyncio.create_task(queue.get())
                    await asyncio.sleep(0)
                    impatient.cancel()
                    outcome = (await asyncio.gather(impatient, return_exceptions=True))[0]
                    taken.extend([outcome] if isinstance(outcome, tuple) else [])
                else:
                    taken.append(await queue.get())
            while True:
                taken.append(await queue.get())

        outcomes = await asyncio.gather(write(), read(), return_exceptions=True)
        assert outcomes[0] is None
        assert isinstance(outcomes[1], QueueClosedError)
        assert taken == sorted(taken)
        assert dropped == sorted(dropped)
        assert sorted(taken + dropped) == list(enumerate(items))
        assert queue.weight == 0

    asyncio.run(scenario())
