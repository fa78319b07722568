"""A chain behind its queue: nothing lost uncounted, nothing held up, everything done before the end."""

from __future__ import annotations

import asyncio
import threading
from contextlib import asynccontextmanager

import pytest

from cellwatt import CellInfo
from cellwatt.runtime.chain import Chain
from cellwatt.runtime.worker import QUEUED_FRAMES, Worker
from tests.daemon.runtime.fakes import JUDGES, LAYOUT, FakeStage, JudgeSettings, alarm, frames_of, prediction, until


def chain_of(*names):
    def maker(name):
        return lambda: FakeStage(name, JudgeSettings(), LAYOUT, CellInfo("plant", "weld", None, None))

    makers = {name: maker(name) for name in names}
    return Chain(makers, {name: make() for name, make in makers.items()})


@asynccontextmanager
async def working(*names):
    """A worker in its task, and what it gave; at the end of the context every stage goes on and the worker ends."""
    results = []
    worker = Worker(chain_of(*names), results.extend)
    task = asyncio.create_task(worker.run())
    try:
        yield worker, results, task
    finally:
        for judge in JUDGES.values():
            judge.gate.set()
        worker.finish()
        await asyncio.wait([task])


async def test_results_come_on_the_loop_in_order():
    async with working("judge") as (worker, results, task):
        JUDGES["judge"].give = lambda frames, _: [prediction("judge", frames.sequence)]
        JUDGES["judge"].last = lambda: [alarm()]
        for n in range(20):
            worker.offer(frames_of(n))
        worker.finish()
        await task
        assert [r.sequence for r in results[:-1]] == list(range(20))
        assert results[-1] == alarm(stage="judge"), "and at the end what the end of the data settles"
        assert JUDGES["judge"].threads == {"stages judge_0"}
        assert threading.current_thread().name not in JUDGES["judge"].threads


async def test_a_slow_stage_holds_up_nobody_and_what_it_drops_is_counted():
    async with working("judge") as (worker, _, task):
        judge = JUDGES["judge"]
        judge.gate.clear()
        worker.offer(frames_of(0))
        await until(judge.inside.is_set)
        for n in range(1, 1 + QUEUED_FRAMES + 30, 10):
            worker.offer(frames_of(n, 10))
        figures = worker.status()["judge"]
        assert (figures["dropped"], figures["waiting"]) == (30, QUEUED_FRAMES // 10)
        judge.gate.set()
        worker.finish()
        await task
        assert judge.seen == [0, *range(31, 1 + QUEUED_FRAMES + 30)], "the oldest went"
        figures = worker.status()["judge"]
        assert figures["frames"] + figures["dropped"] == 1 + QUEUED_FRAMES + 30
        assert figures["waiting"] == 0


async def test_a_full_queue_drops_nothing():
    async with working("judge") as (worker, _, task):
        JUDGES["judge"].gate.clear()
        worker.offer(frames_of(0))
        await until(JUDGES["judge"].inside.is_set)
        worker.offer(frames_of(1, QUEUED_FRAMES))
        assert worker.status()["judge"]["dropped"] == 0
        JUDGES["judge"].gate.set()
        worker.finish()
        await task
        assert JUDGES["judge"].seen == list(range(1 + QUEUED_FRAMES))


async def test_what_is_queued_when_the_end_comes_is_done_first():
    async with working("judge") as (worker, results, task):
        judge = JUDGES["judge"]
        judge.gate.clear()
        judge.give = lambda frames, _: [prediction("judge", frames.sequence)]
        for n in range(5):
            worker.offer(frames_of(n))
        await until(judge.inside.is_set)
        worker.finish()
        assert not task.done()
        judge.gate.set()
        await task
        assert [r.sequence for r in results] == [0, 1, 2, 3, 4]


async def test_cancelled_in_the_middle_it_ends_without_its_stage():
    async with working("judge") as (worker, results, task):
        judge = JUDGES["judge"]
        judge.gate.clear()
        worker.offer(frames_of(0))
        worker.offer(frames_of(1))
        await until(judge.inside.is_set)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert (judge.seen, results) == ([], []), "the stage is still at its first block"


async def test_a_stage_that_raises_leaves_the_others_and_the_worker(caplog):
    def one_is_bad(frames, _):
        if frames.sequence == 1:
            raise KeyError("joint_7")
        return [prediction("first", frames.sequence)]

    async with working("first", "second") as (worker, results, task):
        JUDGES["first"].give = one_is_bad
        JUDGES["second"].give = lambda frames, _: [prediction("second", frames.sequence)]
        for n in range(3):
            worker.offer(frames_of(n))
        worker.finish()
        await task
        assert [(r.model, r.sequence) for r in results] == [("first", 0), ("second", 0), ("second", 1), ("second", 2)]
        figures = worker.status()
        assert (figures["first"]["state"], figures["first"]["failures"]) == ("broken", 1)
        assert figures["second"] == figures["second"] | {"state": "ok", "frames": 3, "results": 3}
    assert "stage first broke" in caplog.text
