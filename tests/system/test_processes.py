"""Processes of the daemon that are killed, crash, hang or grow: the others go on, and nothing is lost or told twice."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from tests.daemon.record.making import numbered_in
from tests.patience import PATIENCE
from tests.system.running import Audience, Daemon, numbers, running, ur

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

RAW = "raw/arm/rtde"


def pid_of(audience: Audience, part: str) -> int:
    return int(audience.status["processes"][part]["pid"])


def recorded(folder: Path) -> Recording:
    return Recording.open(folder / "record")


@asynccontextmanager
async def judged(folder: Path) -> AsyncIterator[tuple[Daemon, Audience]]:
    """A daemon that segments the motion of an arm."""
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device,
        running(folder, f"sources:\n{ur('arm', device.address)}stages: {{segment: {{}}}}\n") as both,
    ):
        yield both


async def killed(audience: Audience, part: str, random: np.random.Generator) -> None:
    """Kill a process at some moment, and wait until its successor has said something."""
    await audience.until(lambda a: part in a.status.get("processes", {}))
    await asyncio.sleep(random.uniform(0, 0.2))
    before = pid_of(audience, part)
    os.kill(before, signal.SIGKILL)
    await audience.until(lambda a: pid_of(a, part) != before)


def may_go_before_others() -> bool:
    return os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_NICE)[1] >= 25  # 20 less the niceness of -5


def priorities(audience: Audience) -> None:
    """Who records goes before other programs, and who judges does not."""
    nice = {name: os.getpriority(os.PRIO_PROCESS, pid_of(audience, name)) for name in audience.status["processes"]}
    assert nice["tell"] < nice["judge segment"]
    assert nice["align"] < nice["judge segment"]
    assert max(nice["tell"], nice["align"]) < os.getpriority(os.PRIO_PROCESS, 0)


async def test_processes_that_are_killed_cost_no_sample(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    async with judged(tmp_path) as (daemon, audience):
        await audience.until(lambda a: a.received[RAW] > 500 and len(a.status.get("processes", {})) == 4)
        if may_go_before_others():
            priorities(audience)
        for part in ("tell", "align") * 2:
            await killed(audience, part, random)
        end = audience.received[RAW] + 500
        await audience.until(lambda a: a.received[RAW] > end)
        assert audience.source("arm")["received"] == audience.source("arm")["expected"]
        assert await daemon.stop() == 0
        assert not audience.gaps
        for got in (numbers(audience.batches[RAW]), numbers(audience.frames)):
            assert np.array_equal(got, np.arange(got[0], got[0] + len(got)))
    kept = await asyncio.to_thread(recorded, tmp_path)
    sequence = (await asyncio.to_thread(kept.batches, "arm", "rtde")).sequence
    assert np.array_equal(sequence, np.arange(len(sequence)))
    blocks = await asyncio.to_thread(list, kept.frames())
    frames = numbers(blocks)
    assert np.array_equal(frames, np.arange(len(frames)))
    assert np.all(np.diff(np.concatenate([f.time for f in blocks])) > 0)
    told = await asyncio.to_thread(numbered_in, tmp_path / "record")
    assert told.keys() == {"event", "interval"}
    assert all([number for number, _ in items] == list(range(len(items))) for items in told.values())
    for part in ("tell", "align"):
        assert f"the process {part} ended by signal SIGKILL" in daemon.log


@pytest.mark.slow
async def test_a_collector_that_is_killed_is_back_at_once(tmp_path: Path) -> None:
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device,
        running(tmp_path, f"sources:\n{ur('arm', device.address)}") as (daemon, audience),
    ):
        await audience.until(lambda a: a.received[RAW] > 500 and "collect" in a.status.get("processes", {}))
        before = pid_of(audience, "collect")
        os.kill(before, signal.SIGKILL)
        await audience.until(lambda a: pid_of(a, "collect") != before and a.source("arm").get("received", 0) > 500)
        assert await daemon.stop() == 0
    kept = await asyncio.to_thread(recorded(tmp_path).batches, "arm", "rtde")
    assert np.all(np.diff(kept.sequence) >= 1)
    assert np.sum(np.diff(kept.sequence) - 1) <= 1, "at most the block in hand when it was killed"
    assert np.all(np.diff(kept.time) > 0)


async def test_what_the_supervisor_leaves_behind_ends_by_itself(tmp_path: Path) -> None:
    async with judged(tmp_path) as (daemon, audience):
        await audience.until(lambda a: a.received[RAW] > 500 and "judge segment" in a.status.get("processes", {}))
        pids = [psutil.Process(p["pid"]) for p in audience.status["processes"].values()]
        assert daemon.process is not None
        daemon.process.kill()
        await daemon.process.wait()
        _, alive = await asyncio.to_thread(psutil.wait_procs, pids, timeout=PATIENCE)
        assert not alive
    assert not list((tmp_path / "record").glob("*.part")), "the record was closed in order"
    sequence = (await asyncio.to_thread(recorded(tmp_path).batches, "arm", "rtde")).sequence
    assert np.array_equal(sequence, np.arange(len(sequence)))
