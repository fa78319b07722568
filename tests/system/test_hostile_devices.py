"""Devices that flood a daemon: the others are read as ever, the log stays small, and it stops when told to."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from cellwatt.emulation import ArmSignals, Emulator
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.emulator import UrEmulator
from cellwatt_drivers.yaskawa.emulator import YaskawaEmulator

from .running import Audience, Daemon

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

MESSAGE = wire.text_message(wire.TextMessage("joint 3\nERROR: all is lost", "controller", 1))
CELL = """
sources:
  loud:  {{driver: ur, host: 127.0.0.1, port: {loud}, rate: 125 Hz}}
  quiet: {{driver: yaskawa, host: 127.0.0.1, port: {quiet}, read: [torque], rate: 50 Hz, timeout: 200 ms}}
"""


@asynccontextmanager
async def served(emulator: Emulator) -> AsyncIterator[int]:
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(emulator.serve(ready.set_result))
    try:
        yield int((await ready).rpartition(":")[2])
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)


async def shout(emulator: UrEmulator) -> None:
    """20,000 text messages a second to everybody, besides the packages."""
    while True:
        for client in emulator.clients:
            if client.unread < 1 << 20:
                client.put(MESSAGE * 200)
        await asyncio.sleep(0.01)


@pytest.mark.slow
async def test_twenty_thousand_messages_a_second_silence_nobody(tmp_path: Path) -> None:
    loud = UrEmulator(ArmSignals(), "127.0.0.1:0")
    quiet = YaskawaEmulator(ArmSignals(), "127.0.0.1:0")
    async with (
        served(loud) as port,
        served(quiet) as other,
        Daemon(tmp_path, CELL.format(loud=port, quiet=other)) as daemon,
        Audience(daemon) as audience,
    ):
        await audience.until(lambda a: a.received["raw/quiet/torque"] > 50 and a.received["raw/loud/rtde"] > 50)
        shouting = asyncio.create_task(shout(loud))
        began = {name: audience.received[name] for name in ("raw/quiet/torque", "raw/loud/rtde")}
        messages = 0

        def told(audience: Audience) -> bool:
            nonlocal messages
            counters = audience.status.get("sources", {}).get("loud", {}).get("counters", {})
            messages = counters.get("event message", 0)
            return messages > 100_000

        await audience.until(told)
        await audience.until(lambda a: any(x.kind == "source_strange" for x in a.results["alarm"]))
        assert audience.received["raw/quiet/torque"] - began["raw/quiet/torque"] > 100
        assert audience.received["raw/loud/rtde"] - began["raw/loud/rtde"] > 250
        assert audience.status["state"] == "amber"
        assert any("events held back" in reason for reason in audience.status["reasons"])
        assert await daemon.stop() == 0
        shouting.cancel()
        await asyncio.gather(shouting, return_exceptions=True)
    lines = daemon.log.splitlines()
    assert sum("controller error" in line for line in lines) <= 200 < messages
    assert not any(line.startswith("ERROR: all is lost") for line in lines)
    assert not audience.unbalanced
