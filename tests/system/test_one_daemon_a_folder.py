"""Two daemons on one record folder: the second says so and stops, whatever became of parts of the first."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path

import pytest

from cellwatt.emulation import EmulatorProcess
from cellwatt.record import Recording
from tests.patience import PATIENCE
from tests.system.running import running
from tests.system.test_daemon import ur
from tests.system.test_processes import RAW, pid_of

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]


async def cellwatt(*arguments: str) -> tuple[int, str]:
    """A command's exit code and what it wrote to stderr."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "cellwatt.commands", *arguments, stderr=asyncio.subprocess.PIPE
    )
    _, said = await asyncio.wait_for(process.communicate(), PATIENCE)
    assert process.returncode is not None
    return process.returncode, said.decode()


@pytest.mark.slow
async def test_the_second_daemon_says_so_and_stops(tmp_path: Path) -> None:
    second, third = tmp_path / "second.yaml", tmp_path / "third"
    third.mkdir()
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as device,
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as other_device,
    ):
        text = f"sources:\n{ur('arm', device.address)}"
        async with running(tmp_path, text) as (daemon, audience):
            await audience.until(lambda a: a.received[RAW] > 100 and "tell" in a.status.get("processes", {}))
            second.write_text(
                f"site: test\ncell: second\nsources:\n{ur('arm', other_device.address)}"
                f"record: {{folder: {tmp_path / 'record'}}}\nzenoh: off\n"
            )
            for command in (["run"], ["record", "--seconds", "5"]):
                code, said = await cellwatt(*command, str(second))
                assert code == 3
                assert said.count("\n") == 1
                assert f"record.folder {tmp_path / 'record'} is taken: another cellwatt records into it" in said
                assert "cell test, process " in said

            # The process that writes is killed: the folder stays the daemon's.
            before = pid_of(audience, "tell")
            os.kill(before, signal.SIGKILL)
            assert (await cellwatt("run", str(second)))[0] == 3
            await audience.until(lambda a: pid_of(a, "tell") != before)
            assert (await cellwatt("run", str(second)))[0] == 3

            # Neither does a reload lead into the folder of another.
            async with running(third, f"sources:\n{ur('arm', other_device.address)}") as (neighbour, visitor):
                await visitor.until(lambda a: a.received[RAW] > 100)
                told = neighbour.file.read_text()
                neighbour.file.write_text(told.replace(str(third / "record"), str(tmp_path / "record")))
                neighbour.hang_up()
                await visitor.until(lambda _: "not reloaded" in neighbour.log)
                assert "a change of record needs a restart; nothing was changed" in neighbour.log
                assert await neighbour.stop() == 0
            assert {p.name.partition("_")[0] for p in (tmp_path / "record").glob("*.mcap*")} == {"test"}
            await daemon.kill()
        # What a dead daemon left behind does not hold up the next one.
        async with running(tmp_path, text) as (daemon, audience):
            await audience.until(lambda a: a.received[RAW] > 100)
            assert await daemon.stop() == 0
    assert await asyncio.to_thread(lambda: len(Recording.open(tmp_path / "record").paths)) >= 2
