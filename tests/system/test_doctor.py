"""``cellwatt doctor``: mistakes that only show when connected, one clear line each."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path
from typing import Any

import pytest

from cellwatt.emulation import EmulatorProcess
from tests.system.running import free_port

pytestmark = [pytest.mark.system, pytest.mark.timeout(90)]


async def doctor(folder: Path, sources: str, *options: str) -> tuple[int, dict[str, Any], str]:
    file = folder / "cell.yaml"
    file.write_text(f"site: test\ncell: test\nsources:\n{sources}")
    command = [sys.executable, "-m", "cellwatt.commands", "doctor", str(file), "--seconds", "3", "--json", *options]
    pipe = asyncio.subprocess.PIPE
    process = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)
    out, err = await process.communicate()
    assert b"Traceback" not in err
    assert process.returncode is not None
    return process.returncode, json.loads(out), err.decode()


@pytest.mark.slow
async def test_good_devices(tmp_path: Path) -> None:
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as arm,
        EmulatorProcess("power_board", "--listen", "pty") as board,
    ):
        host, port = arm.address.split(":")
        sources = f"  arm: {{driver: ur, host: {host}, port: {port}}}\n"
        sources += f"  board: {{driver: power_board, port: {board.address}}}\n"
        code, found, _ = await doctor(tmp_path, sources)
    assert code == 0
    stream = found["arm"]["status"]["streams"]["rtde"]
    assert found["arm"]["verdict"] == "ok", found["arm"]["findings"]
    assert stream["rate_hz"] == pytest.approx(500, rel=0.02)
    assert {c["unit"] for c in found["arm"]["channels"]} >= {"rad", "rad/s", "A", "degC"}
    assert found["board"]["status"]["clocks"]["power"]["bound_ns"] > 0


@pytest.mark.slow
async def test_wrong_places(tmp_path: Path) -> None:
    async with (
        EmulatorProcess("scpi_analyzer", "--listen", "127.0.0.1:0") as meter,
        EmulatorProcess("power_board", "--listen", "pty", "--option", "mode=transparent") as board,
        EmulatorProcess("ur", "--listen", "127.0.0.1:0") as arm,
    ):
        address = {"meter": meter.address.split(":"), "arm": arm.address.split(":")}
        sources = (
            f"  nobody: {{driver: ur, host: 127.0.0.1, port: {free_port()}}}\n"
            f"  wrong_device: {{driver: ur, host: 127.0.0.1, port: {address['meter'][1]}, timeout: 1 s}}\n"
            f"  also_wrong: {{driver: scpi_analyzer, host: 127.0.0.1, port: {address['arm'][1]}}}\n"
            f"  wrong_mode: {{driver: power_board, port: {board.address}}}\n"
            "  no_port: {driver: power_board, port: /dev/serial/by-id/none}\n"
            f"  silent: {{driver: yaskawa, host: 127.0.0.1, port: {free_port()}, read: [torque]}}\n"
            "  no_host: {driver: ur, host: no-such-host.invalid}\n"
        )
        code, found, _ = await doctor(tmp_path, sources, "--patience", "10")
    assert code == 1
    assert all(e["verdict"] == "failed" and len(e["findings"]) == 1 for e in found.values()), found
    said = {name: e["findings"][0] for name, e in found.items()}
    assert all("\n" not in text for text in said.values())
    assert "Connection refused" in said["nobody"]
    assert "mode" in said["wrong_mode"]
    assert "/dev/serial/by-id/none" in said["no_port"]
    assert "no-such-host.invalid" in said["no_host"]
