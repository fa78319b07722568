"""The daemon as a process: start, stop, reload, what it tells, what it leaves."""

from __future__ import annotations

import asyncio
import json
import select
import socket
import struct
from pathlib import Path

import numpy as np
import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from tests.patience import eventually
from tests.system.running import Audience, Daemon, balanced, cellwatt, free_port, numbers, running, ur

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


async def test_a_subscriber_gets_what_is_recorded_and_replay_gives_the_same(tmp_path: Path) -> None:
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device,
        EmulatorProcess("power_board", "--listen", "pty", "--fault", "loss:probability=2%") as board,
    ):
        sources = f"sources:\n{ur('arm', device.address)}  board: {{driver: power_board, port: {board.address}}}\n"
        async with running(tmp_path, sources + "stages: {segment: {arm: arm}}\n") as (daemon, audience):
            await audience.until(lambda a: a.received["frame"] > 200 and len(a.results["interval"]) > 3)
            assert balanced(audience.source("arm"))
            assert await daemon.stop() == 0
    recorded = await asyncio.to_thread(Recording.open(tmp_path / "record").batches, "arm", "rtde")
    got = audience.batches["raw/arm/rtde"]
    first = got[0].sequence
    values, times = (np.concatenate([getattr(batch, name) for batch in got]) for name in ("values", "time"))
    mine = slice(first, first + len(values))
    np.testing.assert_array_equal(recorded.values[mine], values)
    np.testing.assert_array_equal(recorded.time[mine], times)
    # A subscriber that is not scheduled may miss the last ones: there is nobody left whom it could ask.
    assert len(recorded) >= max(first + len(values), audience.source("arm")["received"])
    assert not audience.gaps
    words = ("replay", str(tmp_path / "record"), "--settings", str(daemon.file), "--verify", "--json")
    code, out, err = await cellwatt(*words)
    lines = out.splitlines()
    summary = json.loads(lines[-1])
    assert summary["identical"], summary
    assert code == 0, err
    replayed = [json.loads(line) for line in lines[:-1]]
    live = [i for i in audience.results["interval"] if i.closed]
    again = [i for i in replayed if i["kind"] == "interval" and i["closed"]]
    starts, heard = [i["start"] for i in again], [i.start for i in live]
    first = starts.index(heard[0])  # of the last ones a subscriber may hear nothing, when the daemon is gone
    assert starts[first : first + len(heard)] == heard


_SENDER = struct.Struct("iII")
"""Process, user and group that sent a message, as the kernel tells."""


async def test_ready_and_alive_for_systemd_with_every_device_down(tmp_path: Path) -> None:
    path = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(path))
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        sources = "sources:\n" + "".join(ur(f"arm_{i}", f"127.0.0.1:{free_port()}") for i in range(3))
        daemon = Daemon(tmp_path, sources)
        await daemon.start(NOTIFY_SOCKET=str(path))
        try:
            assert daemon.process is not None
            first_process = daemon.process.pid

            async def message() -> str:
                await eventually(lambda: select.select([listener], [], [], 0)[0], "a word to systemd")
                said, [(_, _, sender)], *_ = listener.recvmsg(4096, socket.CMSG_SPACE(_SENDER.size))
                assert _SENDER.unpack(sender)[0] == first_process, "the unit lets nobody else speak"
                return said.decode()

            said = [await message()]
            while "READY=1" not in said[-1]:
                said.append(await message())
            while "WATCHDOG=1" not in said[-1]:
                said.append(await message())
            async with Audience(daemon) as audience:
                await audience.until(lambda a: len([x for x in a.alarms if x.kind == "source_down"]) == 3)
            assert await daemon.stop() == 0
            while "STOPPING=1" not in said[-1]:
                said.append(await message())
        finally:
            await daemon.kill()


async def test_reload_touches_only_what_changed(tmp_path: Path) -> None:
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as one,
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as two,
    ):
        kept = ur("kept", one.address)
        text = f"sources:\n{kept}{ur('moved', two.address)}stages: {{segment: {{arm: kept}}}}\n"
        async with running(tmp_path, text) as (daemon, audience):
            await audience.until(Audience.all_up)
            daemon.write(
                f"sources:\n{kept}{ur('moved', two.address, rate='250 Hz')}stages: {{segment: {{arm: kept}}}}\n"
            )
            daemon.hang_up()
            await audience.until(lambda a: any(e.kind == "reloaded" for e in a.events))
            await audience.until(lambda a: a.source("moved").get("streams", {})["rtde"]["nominal_hz"] == 250.0)
            mark = audience.received["raw/moved/rtde"]
            await audience.until(lambda a: a.received["raw/moved/rtde"] > mark + 200)
            text = next(e.text for e in audience.events if e.kind == "reloaded")
            assert "source moved" in text
            assert "kept" not in text
            assert audience.source("kept")["missed"] == {}
            assert audience.source("kept")["counters"].get("restarts", 0) == 0
            assert (np.diff(numbers(audience.batches["raw/kept/rtde"])) == 1).all()
            assert (np.diff(numbers(audience.frames)) == 1).all(), "frames stay numbered without holes or twins"
            daemon.file.write_text("sources: [nonsense\n")
            daemon.hang_up()
            mark = audience.received["raw/kept/rtde"]
            await audience.until(lambda a: a.received["raw/kept/rtde"] > mark + 500)
            assert "not reloaded" in daemon.log
            assert await daemon.stop() == 0
