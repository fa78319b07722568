"""Attacks on a running daemon as a process: doors filled, few descriptors, a record folder that is taken away."""

from __future__ import annotations

import asyncio
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from tests.patience import eventually
from tests.system.running import Audience, Daemon, free_port, running
from tests.system.test_daemon import ur
from tests.system.test_processes import RAW

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(300)]


async def test_a_filled_door_and_a_record_folder_that_is_removed(tmp_path: Path) -> None:
    """Both at one daemon, as a daemon takes seconds to start."""
    port = free_port()
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device:
        text = (
            f"sources:\n{ur('arm', device.address)}metrics: {{listen: '127.0.0.1:{port}', token: t0p-t0p-t0p-t0p0}}\n"
        )
        async with running(tmp_path, text) as (daemon, audience):
            await audience.until(lambda a: a.received[RAW] > 100 and a.status["sinks"]["metrics"].get("url"))
            await strangers_fill_a_door(port, audience)
            await the_folder_is_removed(tmp_path, audience)
            lost = audience.status["recorder"]["displaced"]["messages"]
            assert await daemon.stop() == 0
        assert len(daemon.log) < 100_000
    kept = Recording.open(tmp_path / "record")
    assert len(kept.batches("arm", "rtde")) + lost > 500
    assert "record_displaced" in {alarm.kind for alarm in kept.alarms()}, "what was lost is in the record that follows"


async def strangers_fill_a_door(port: int, audience: Audience) -> None:
    before = audience.source("arm")["received"]
    idle = [await asyncio.open_connection("127.0.0.1", port) for _ in range(900)]
    try:
        await audience.until(lambda a: any(alarm.kind == "door_flooded" for alarm in a.alarms))
    finally:
        for _, writer in idle:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
    assert audience.status["recorder"]["state"] == "ok"
    assert audience.source("arm")["received"] > before
    assert not audience.source("arm")["dropped"]
    assert audience.status["sinks"]["metrics"]["state"] == "ok"


async def the_folder_is_removed(folder: Path, audience: Audience) -> None:
    shutil.rmtree(folder / "record")
    await audience.until(lambda a: any(alarm.kind == "record_displaced" for alarm in a.alarms))
    alarm = next(alarm for alarm in audience.alarms if alarm.kind == "record_displaced")
    assert "was removed while it was written: the record lacks its" in alarm.statement
    assert list((folder / "record").glob("*.mcap*")), "recording goes on"
    assert audience.status["recorder"]["drops"]


async def test_a_daemon_with_64_descriptors_records(tmp_path: Path) -> None:
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device:
        daemon = Daemon(tmp_path, f"sources:\n{ur('arm', device.address)}")
        await daemon.start(descriptors=64)
        try:
            await eventually(lambda: list((tmp_path / "record").glob("*.mcap*")), "a recording")
            assert "only 64 files and connections may be open (ulimit -n)" in daemon.log
            await asyncio.sleep(3)  # some samples
            assert await daemon.stop() == 0
        finally:
            await daemon.kill()
    assert len(Recording.open(tmp_path / "record").batches("arm", "rtde")) > 100
