"""Attacks on running daemons as processes: one daemon with all doors, and one with few rights."""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from asyncua import Client, ua

from cellwatt.emulation import EmulatorProcess
from cellwatt.outlets.page.sessions import hash_of
from cellwatt.record import Recording
from tests.daemon.outlets.mqtt.broker import Broker, needs_mosquitto
from tests.patience import eventually
from tests.system.running import Audience, Daemon, free_port, running, ur
from tests.system.test_processes import RAW

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(300)]

TOKEN, SECRET = "t0p-t0p-t0p-t0p0", "hunter2-night-shift"
NODE = "spBv1.0/test/{}/test"


class Doors:
    """A cell's doors by name, and its settings."""

    def __init__(self, folder: Path, arm: str, broker: Broker) -> None:
        self.ports = {name: free_port() for name in ("page", "metrics", "opc_ua")}
        at = {name: f"127.0.0.1:{port}" for name, port in self.ports.items()}
        self.urls = {name: f"http://{address}" for name, address in at.items()}
        self.lake = folder / "lake"
        self.text = f"""
sources:
{ur("arm", arm)}metrics: {{listen: "{at["metrics"]}", token: {TOKEN}}}
page: {{listen: "{at["page"]}", users: {{ada: {{password: "{hash_of("right", 2**14)}"}}}}}}
opc_ua: {{listen: "{at["opc_ua"]}", users: {{ada: right}}}}
mqtt: {{broker: "{broker.url}", format: sparkplug}}
historian: {{lake: {{folder: {self.lake}, every: 1 s}}}}
"""

    @asynccontextmanager
    async def open_opc_ua(self) -> AsyncIterator[Client]:
        client = Client(f"opc.tcp://127.0.0.1:{self.ports['opc_ua']}/cellwatt")
        client.set_user("ada")
        client.set_password("right")
        async with client:
            yield client


@needs_mosquitto
async def test_all_doors_of_a_daemon(tmp_path: Path) -> None:
    """One daemon for all attacks, as it takes seconds to start."""
    broker = Broker(tmp_path)
    await asyncio.to_thread(broker.start)
    try:
        async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as arm:
            doors = Doors(tmp_path, arm.address, broker)
            async with running(tmp_path, doors.text) as (daemon, audience):
                await audience.until(all_open)
                before = audience.source("arm")["received"]
                await strangers_fill_each_door(doors, audience)
                await guesses_wait_and_are_told(doors, audience)
                await the_lake_is_removed(doors, audience)
                assert audience.source("arm")["received"] > before
                assert not audience.source("arm")["dropped"]
                assert audience.status["recorder"]["state"] == "ok"
                await the_folder_is_removed(tmp_path, audience)
                lost = audience.status["recorder"]["displaced"]["messages"]
                assert await daemon.stop() == 0
            assert len(daemon.log) < 100_000
            assert "Traceback" not in daemon.log
    finally:
        broker.kill()
    kept = Recording.open(tmp_path / "record")
    assert len(kept.batches("arm", "rtde")) + lost > 500
    assert "record_displaced" in {alarm.kind for alarm in kept.alarms()}, "what was lost is in the record that follows"


def all_open(audience: Audience) -> bool:
    outlets = audience.status.get("sinks", {}).values()
    return audience.received[RAW] > 100 and len(outlets) == 6 and all(o["state"] == "ok" for o in outlets)


async def strangers_fill_each_door(doors: Doors, audience: Audience) -> None:
    idle = [await asyncio.open_connection("127.0.0.1", port) for port in doors.ports.values() for _ in range(500)]
    try:
        await audience.until(lambda a: flooded(a) == set(doors.ports))
        async with aiohttp.ClientSession(headers={"Authorization": f"Bearer {TOKEN}"}) as session:
            for url in (f"{doors.urls['metrics']}/metrics", f"{doors.urls['page']}/api/site"):
                async with session.get(url) as answer:
                    assert answer.status == 200
        async with doors.open_opc_ua() as client:
            assert await client.get_namespace_array()
    finally:
        for _, writer in idle:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()
    assert all_open(audience)


def flooded(audience: Audience) -> set[str]:
    return {alarm.id.partition(":")[2] for alarm in audience.alarms if alarm.kind == "door_flooded"}


async def guesses_wait_and_are_told(doors: Doors, audience: Audience) -> None:
    statuses: dict[str, list[int]] = {"metrics": [], "page": []}
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar) as session:
        async with session.get(f"{doors.urls['page']}/api/site") as answer:
            proof = {"X-CSRF-Token": (await answer.json())["csrf"]}
        for _ in range(20):
            wrong = {"Authorization": "Bearer guess"}
            async with session.get(f"{doors.urls['metrics']}/metrics", headers=wrong) as answer:
                statuses["metrics"].append(answer.status)
            body = {"name": "ada", "password": "guess"}
            async with session.post(f"{doors.urls['page']}/api/login", json=body, headers=proof) as answer:
                statuses["page"].append(answer.status)
        right = {"Authorization": f"Bearer {TOKEN}"}
        async with session.get(f"{doors.urls['metrics']}/metrics", headers=right) as answer:
            assert answer.status == 200, "nobody locks Prometheus out"
    for found in statuses.values():
        assert found[:5] == [401] * 5
        assert 429 in found
    for _ in range(8):
        stranger = Client(f"opc.tcp://127.0.0.1:{doors.ports['opc_ua']}/cellwatt")
        stranger.set_user("eve")
        stranger.set_password("guess")
        with pytest.raises(ua.UaStatusCodeError, match="BadUserAccessDenied"):
            await stranger.connect()
    await audience.until(lambda a: {x.id for x in a.alarms} >= {f"door_tried:{name}" for name in doors.ports})


async def the_lake_is_removed(doors: Doors, audience: Audience) -> None:
    await eventually(lambda: list(doors.lake.rglob("*.parquet")), "a file of the lake")
    shutil.rmtree(doors.lake.rename(doors.lake.with_name("drained")))
    await eventually(lambda: list(doors.lake.rglob("*.parquet")), "a new file of the lake")


async def the_folder_is_removed(folder: Path, audience: Audience) -> None:
    shutil.rmtree((folder / "record").rename(folder / "gone"))  # nobody writes into it meanwhile
    await audience.until(lambda a: any(alarm.kind == "record_displaced" for alarm in a.alarms))
    alarm = next(alarm for alarm in audience.alarms if alarm.kind == "record_displaced")
    assert "while it was written: the record lacks its" in alarm.statement
    assert list((folder / "record").glob("*.mcap*")), "recording goes on"
    assert audience.status["recorder"]["drops"]


UNDER = ("prlimit", "--nofile=64", "setpriv", "--bounding-set=-dac_override,-dac_read_search")
"""Few descriptors; and rights count for root as for anybody."""


async def test_a_daemon_with_64_descriptors_whose_folder_loses_its_rights(tmp_path: Path) -> None:
    """What the disk does not take waits in memory, and is written once it may be."""
    folder = tmp_path / "record"
    async with EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device:
        daemon = Daemon(tmp_path, f"sources:\n{ur('arm', device.address)}", record="file_age: 1 s")
        await daemon.start(*(UNDER if os.geteuid() == 0 else UNDER[:2]))
        try:
            await eventually(lambda: list(folder.glob("*.mcap")), "a whole file")
            assert "only 64 files and connections may be open (ulimit -n)" in daemon.log
            folder.chmod(0o500)
            await eventually(lambda: f"{folder} cannot be written: Permission denied" in daemon.log, "the alarm")
            folder.chmod(0o700)
            await eventually(lambda: "recording works again" in daemon.log, "the end of the alarm")
            assert await daemon.stop() == 0
        finally:
            await daemon.kill()
    kept = Recording.open(folder)
    assert not kept.damage
    assert (np.diff(kept.batches("arm", "rtde").sequence) == 1).all()
    assert [(a.kind, a.active) for a in kept.alarms() if a.kind == "recorder"] == [
        ("recorder", True),
        ("recorder", False),
    ]
