"""``cellwatt health`` towards a daemon: exit code 0 while a source delivers, 1 once none does, 3 once it has ended."""

from __future__ import annotations

import json
from collections.abc import Awaitable
from pathlib import Path

import pytest

from cellwatt.emulation import EmulatorProcess
from tests.system.running import Daemon, cellwatt, free_port, running, ur

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


def health(daemon: Daemon, *more: str) -> Awaitable[tuple[int | None, str, str]]:
    return cellwatt("health", str(daemon.file), *more)


@pytest.mark.slow
async def test_exit_codes_from_start_to_end(tmp_path: Path) -> None:
    port = free_port()
    async with running(tmp_path, f"sources:\n{ur('arm', f'127.0.0.1:{port}')}") as (daemon, audience):
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
