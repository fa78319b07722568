import asyncio
import time
from pathlib import Path

from cellwatt.ticker import Ticker
from tests.patience import PATIENCE

MILLISECOND = 1_000_000


def open_timers() -> int:
    links = []
    for entry in Path("/proc/self/fd").iterdir():
        try:
            links.append(str(entry.readlink()))
        except FileNotFoundError:  # the descriptor of the listing itself
            continue
    return sum("timerfd" in link for link in links)


def busy_until(deadline):
    while time.monotonic_ns() < deadline:
        pass


async def take(ticker, n):
    beats = []
    async for beat in ticker:
        beats.append(beat)
        if len(beats) == n:
            break
    return beats


async def test_beats_at_exact_multiples_of_the_period_and_never_early():
    async with Ticker(300) as ticker:
        first = None
        k = 0
        for _ in range(30):
            beat = await anext(ticker)
            assert time.monotonic_ns() >= beat.deadline
            first = beat.deadline if first is None else first
            k += beat.merged if k else 0
            assert abs(beat.deadline - first - k * 1e9 / 300) <= 1
            k += 1


async def test_the_first_beat_comes_within_twenty_milliseconds_however_slow_the_rate():
    async with Ticker(0.01) as ticker:
        entered = time.monotonic_ns()
        beat = await asyncio.wait_for(anext(ticker), PATIENCE)
        assert beat.deadline - entered <= 20 * MILLISECOND


async def test_a_deadline_that_is_left_out_wakes_nobody_and_is_not_missed():
    async with Ticker(200) as ticker:
        first = await anext(ticker)
        ticker.skip()
        second = await anext(ticker)
    periods = round((second.deadline - first.deadline) / (5 * MILLISECOND))
    assert periods - second.merged == 2


async def test_an_overrun_is_merged_into_the_newest_deadline_and_counted():
    async with Ticker(1000) as ticker:
        first = await anext(ticker)
        busy_until(first.deadline + 5 * MILLISECOND)
        second = await anext(ticker)
    steps = round((second.deadline - first.deadline) / MILLISECOND)
    assert steps >= 5
    assert second.merged == steps - 1


async def test_a_body_that_always_overruns_lets_others_run():
    turns = 0

    async def other():
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    task = asyncio.create_task(other())
    async with Ticker(1e6) as ticker:
        await take(ticker, 20)
    task.cancel()
    assert turns >= 10


async def test_no_deadline_is_lost_when_a_wait_is_cancelled():
    async with Ticker(200) as ticker:
        last = await anext(ticker)
        for _ in range(20):
            try:
                async with asyncio.timeout(0.001):
                    beat = await anext(ticker)
            except TimeoutError:
                continue
            assert beat.deadline - last.deadline == (beat.merged + 1) * 5 * MILLISECOND
            last = beat
        beat = await anext(ticker)
        assert beat.deadline - last.deadline == (beat.merged + 1) * 5 * MILLISECOND


async def test_all_tickers_of_a_loop_share_one_timer_which_the_last_one_closes():
    before = open_timers()
    async with Ticker(100) as one:
        async with Ticker(50) as two, Ticker(1) as three:
            assert open_timers() == before + 1
            await asyncio.gather(take(one, 3), take(two, 2), take(three, 1))
        assert open_timers() == before + 1
        await take(one, 2)
    assert open_timers() == before


async def test_cancelled_tasks_leave_no_timer_behind():
    before = open_timers()

    async def run():
        async with Ticker(5) as ticker:
            await take(ticker, 1000)

    tasks = [asyncio.create_task(run()) for _ in range(10)]
    await asyncio.sleep(0)
    assert open_timers() == before + 1
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert open_timers() == before
