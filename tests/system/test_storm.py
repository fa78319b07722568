"""Devices that misbehave: all faults at once, for as long as one likes; each alone is tested with its driver."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import time
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from tests.patience import PATIENCE
from tests.system.running import Audience, Daemon, balanced, running

pytestmark = pytest.mark.system

STORM = float(os.environ.get("CELLWATT_STORM_SECONDS", "12"))
ONE_SHOT = {"stall", "disconnect", "clock_jump"}
KINDS = {
    "arm": ("loss", "delay", "stall", "disconnect", "half_frame", "garbage", "clock_jump"),
    "board": ("loss", "half_frame", "garbage", "duplicate", "reorder", "delay", "stall", "disconnect"),
    "second": ("delay", "reorder", "duplicate", "loss", "garbage", "half_frame", "stall", "disconnect"),
    "mains": ("delay", "stall", "disconnect", "garbage", "half_frame", "loss"),
}  # fmt: skip
RARE = {("arm", "half_frame"), ("arm", "garbage"), ("mains", "garbage"), ("mains", "half_frame"), ("mains", "loss")}
"""These cost the connection, or a time-out, each time they strike."""


@contextlib.asynccontextmanager
async def cell(folder: Path) -> AsyncIterator[tuple[Daemon, Audience, dict[str, EmulatorProcess]]]:
    link = folder / "tty"
    async with contextlib.AsyncExitStack() as stack:
        devices = {
            "arm": EmulatorProcess("ur", "--listen", "127.0.0.1:0"),
            "board": EmulatorProcess("power_board", "--listen", "pty", "--option", f"link={link}"),
            "second": EmulatorProcess("yaskawa", "--listen", "127.0.0.1:0", "--option", "answer_ms=3"),
            "mains": EmulatorProcess("scpi_analyzer", "--listen", "127.0.0.1:0"),
        }
        for device in devices.values():
            await stack.enter_async_context(device)
        place = {n: d.address.rsplit(":", 1) for n, d in devices.items()}
        text = f"""
sources:
  arm: {{driver: ur, host: {place["arm"][0]}, port: {place["arm"][1]}}}
  board: {{driver: power_board, port: {link}, silence: 1 s}}
  second:
    {{driver: yaskawa, host: {place["second"][0]}, port: {place["second"][1]},
     pulses_per_degree: [1341.4, 1341.4, 1341.4, 1000, 1000, 622]}}
  mains: {{driver: scpi_analyzer, host: {place["mains"][0]}, port: {place["mains"][1]}}}
stages: {{segment: {{arm: arm}}}}
"""
        daemon, audience = await stack.enter_async_context(running(folder, text))
        await audience.until(Audience.all_up)
        yield daemon, audience, devices


def strike(name: str, kind: str, rng: random.Random) -> str:
    if kind in ONE_SHOT:
        return f"{kind}:seconds={rng.choice([0.2, 0.5, 1.0])}s"
    probability = "0.2%" if (name, kind) in RARE else "5%"
    return f"{kind}:probability={probability},for=1s" + ",seconds=50ms" * (kind == "delay")


async def storm(folder: Path, seconds: float, seed: int) -> None:
    rng = random.Random(seed)
    async with cell(folder) as (daemon, audience, devices):
        start = time.monotonic()
        while time.monotonic() - start < seconds:
            # What is away already cannot go away: faults queued meanwhile would strike one by one at each return.
            name = rng.choice([n for n in KINDS if audience.source(n)["state"] == "ok"] or list(KINDS))
            await devices[name].strike(strike(name, rng.choice(KINDS[name]), rng))
            await asyncio.sleep(rng.uniform(0.1, 0.6))
        for name, device in devices.items():
            for kind in set(KINDS[name]) - ONE_SHOT:
                await device.strike(f"{kind}:probability=0%")
        marks = {n: audience.source(n)["received"] for n in KINDS}
        await audience.until(lambda a: all(a.source(n)["received"] > m + 20 for n, m in marks.items()), 2 * PATIENCE)
        assert not audience.unbalanced, audience.unbalanced[:3]
        assert not audience.gaps
        assert audience.status["loop_lag_ms"] < 1000
        assert await daemon.stop() == 0
        assert all(balanced(audience.source(n)) for n in KINDS)
        assert "Traceback" not in daemon.log
        assert all(audience.source(n)["counters"].get("driver bugs", 0) == 0 for n in KINDS)
    await asyncio.to_thread(compare, Recording.open(folder / "record"), audience)


def compare(recording: Recording, audience: Audience) -> None:
    """What was heard is what is recorded, in order."""
    assert not recording.damage
    for topic, got in audience.batches.items():
        _, source, stream = topic.split("/")
        recorded = recording.batches(source, stream)
        values = np.concatenate([b.values for b in got])
        np.testing.assert_array_equal(recorded.values[got[0].sequence :][: len(values)], values)
        assert (np.diff(recorded.time) > 0).all(), f"{topic}: time stepped back"


@pytest.mark.slow
@pytest.mark.timeout(STORM + 200)
async def test_all_faults_together(tmp_path: Path) -> None:
    await storm(tmp_path, STORM, seed=1)
