"""``cellwatt health`` towards a daemon: exit code 0 while a source delivers, 1 once none does, 3 once it has ended."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

import pytest

from cellwatt.emulation import EmulatorProcess
from tests.patience import PATIENCE
from tests.system.running import Daemon, free_port, running

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


async def health(daemon: Daemon, *more: str) -> tuple[int, str, str]:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "cellwatt.commands", "health", str(daemon.file), *more), stdout=-1, stderr=-1
    )
    out, err = await asyncio.wait_for(process.communicate(), PATIENCE)
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


@pytest.mark.slow
async def test_exit_codes_from_start_to_end(tmp_path: Path) -> None:
    port = free_port()
    source = f"sources:\n  arm: {{driver: ur, host: 127.0.0.1, port: {port}}}\n"
    async with running(tmp_path, source) as (daemon, audience):
        async with EmulatorProcess("ur", "--listen", f"127.0.0.1:{port}"):
            await audience.until(lambda a: a.all_up() and a.status["state"] == "green")
            assert await health(daemon) == (0, "green: 1 of 1 sources are up\n", "")
            code, out, _ = await health(daemon, "--json")
            status = json.loads(out)["status"]
            assert (code, status["state"], status["sources"]["arm"]["state"]) == (0, "green", "ok")
        await audience.until(lambda a: a.status["state"] == "red")
        assert await health(daemon) == (1, "red: 0 of 1 sources are up\n", "")
        assert await daemon.stop() == 0
        code, out, err = await health(daemon)
        assert (code, out) == (3, "")
        assert err.startswith(f"cellwatt: {daemon.endpoint}: no answer")
