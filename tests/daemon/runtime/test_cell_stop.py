"""A stop: sources first, then what is queued, then outlets and record; and nobody can hold it up for ever."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from cellwatt import Alarm, Frames
from cellwatt.record import Recording
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import (
    DEVICES,
    JUDGES,
    RECEIVERS,
    FakeDriver,
    FakeOutlet,
    alarm,
    answer,
    config_of,
    fail,
    give,
    prediction,
    running,
    sources,
    stages,
    until,
)
from tests.daemon.runtime.one_process import Cell


async def test_everything_accepted_is_judged_published_and_recorded(tmp_path):
    judge = JUDGES["judge"]
    judge.give = lambda frames, _: [prediction("judge", frames.sequence)]
    judge.last = lambda: [alarm("at the end")]
    judge.gate.clear()
    async with running(config_of(stages=stages("judge"), record=tmp_path)) as cell:
        DEVICES["arm"].tell(answer, give(200))
        await DEVICES["arm"].done()
        await until(judge.inside.is_set)
        cell.stop()
        await until(lambda: not DEVICES["arm"].open)
        assert not judge.seen, "the stage still has everything before it"
        judge.gate.set()
    bus, recording = RECEIVERS["bus"], Recording.open(tmp_path)
    recorded = [int(v) for b in recording.entries() if hasattr(b, "values") for v in b.values[:, 0]]
    assert recorded == bus.values == list(range(200))
    assert judge.seen == bus.frames == list(range(len(bus.frames)))
    assert len(judge.seen) >= 199
    results = list(recording.results())
    assert [r.sequence for r in results[:-1]] == judge.seen
    assert results[-1] == alarm("at the end", stage="judge")
    assert [a for a in bus.of(Alarm) if a.stage] == [alarm("at the end", stage="judge")]
    assert not list(tmp_path.glob("*.part")), "the file is closed"


@at_once
async def test_frames_that_waited_for_a_silent_source_are_given_at_the_end():
    def newest():
        # A block may hold nothing of the arm: where it comes late, ticks give out frames without it.
        columns = [f.values[:, f.layout.index("arm.bus.voltage")] for f in RECEIVERS["bus"].of(Frames)]
        return np.nanmax(np.concatenate(columns))

    DEVICES["board"].tell(answer, give(1))
    async with running(config_of(sources=sources("arm", "board"))):
        await DEVICES["board"].done()
        DEVICES["arm"].tell(answer, give(20))
        await DEVICES["arm"].done()
        assert newest() < 16, "the last 100 ms wait"
    assert newest() > 18, "up to the last sample, 19 V"


@at_once
async def test_outlets_are_open_until_the_last_item(monkeypatch):
    offered = []
    offer = FakeOutlet.offer

    def noting(self, item):
        offered.append(RECEIVERS[self.name].open)
        offer(self, item)

    monkeypatch.setattr(FakeOutlet, "offer", noting)
    DEVICES["arm"].tell(answer, give(5))
    async with running(config_of()):
        await DEVICES["arm"].done()
    assert set(offered) == {1}
    assert RECEIVERS["bus"].open == 0


@at_once
async def test_sources_give_nothing_once_it_stops():
    async with running(config_of()) as cell:
        DEVICES["arm"].tell(answer, give(3))
        await DEVICES["arm"].done()
        cell.stop()
        await until(lambda: not RECEIVERS["bus"].open)
        DEVICES["arm"].tell(give(3))
    assert RECEIVERS["bus"].values == [0, 1, 2]


@at_once
async def test_health_is_told_once_more_at_the_end():
    async with running(config_of()) as cell:
        DEVICES["arm"].tell(answer, give(3))
        await DEVICES["arm"].done()
    assert cell.view.status()["sources"]["arm"]["received"] == 3
    assert RECEIVERS["bus"].health[-1]["sources"]["arm"]["received"] == 3


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


@at_once
async def test_a_cell_that_is_cancelled_lets_its_devices_go():
    with pytest.raises(asyncio.CancelledError):
        async with running(config_of()) as cell:
            task = next(t for t in asyncio.all_tasks() if "Cell.run" in repr(t.get_coro()))
            await until(lambda: DEVICES["arm"].open)
            task.cancel()
            await asyncio.wait([task])
            assert task.cancelled()
            assert (DEVICES["arm"].open, RECEIVERS["bus"].open) == (0, 0)
            assert cell.view.status()["state"]


@at_once
async def test_stopped_while_a_source_pauses():
    DEVICES["arm"].tell(fail(OSError("gone")))
    async with running(config_of()):
        await until(lambda: "lost" in RECEIVERS["bus"].told)
    assert len(DEVICES["arm"].runs) == 1


@at_once
async def test_stopped_before_it_is_ready():
    cell = Cell(config_of())
    cell.stop()
    await cell.run()
    assert (DEVICES["arm"].open, RECEIVERS["bus"].open) == (0, 0)
