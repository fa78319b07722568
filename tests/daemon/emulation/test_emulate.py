"""``cellwatt emulate``: faults in words, the devices of a cell, and the copy of its settings."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from cellwatt.commands.emulate import command
from cellwatt.config import load
from cellwatt.emulation.cell import devices_of, faults_by_device
from cellwatt.errors import ConfigError
from tests.patience import PATIENCE
from tests.system.running import free_port

CELL = """\
site: test
cell: test
sources:
  arm: {{driver: ur, host: {host}, port: {arm}}}        # the arm
  supply:                                               # its supply
    driver: scpi_analyzer
    host: {host}
    port: {supply}
  board: {{driver: power_board, port: {folder}/board}}
"""


def cell(folder: Path, host: str = "127.0.0.1") -> Path:
    file = folder / "cell.yaml"
    file.write_text(CELL.format(host=host, arm=free_port(), supply=free_port(), folder=folder))
    return file


def refusal(*arguments: str) -> str:
    """The one line with which the command refuses its arguments."""
    result = CliRunner().invoke(command, list(arguments))
    assert isinstance(result.exception, ConfigError), result.output
    (line,) = str(result.exception).splitlines()
    return line


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("sprng:joint=3", "did you mean 'spring'?"),
        ("spring:jiont=3", "did you mean 'joint'?"),
        ("spring:at=20s", "spring needs joint"),
        ("stall:at=20s", "stall needs seconds"),
        ("loss:probability=1 bar", "unknown unit 'bar'"),
        ("reorder", "cannot inject reorder; it can: loss"),
    ],
)
def test_a_fault_that_is_not_understood_is_told_in_one_line(fault: str, told: str) -> None:
    assert told in refusal("ur", "--fault", fault)


def test_faults_of_a_cell_go_to_their_devices(tmp_path: Path) -> None:
    devices = devices_of(load(cell(tmp_path)))
    texts = ("spring:joint=3,at=20s", "board/loss:probability=1%", "arm,board/encoder:joint=1")
    assert faults_by_device(texts, devices) == {
        "arm": ["spring:joint=3,at=20s", "encoder:joint=1"],
        "supply": ["spring:joint=3,at=20s"],
        "board": ["spring:joint=3,at=20s", "loss:probability=1%", "encoder:joint=1"],
    }


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("loss:probability=1%", "expected its source first, like arm/loss:probability=1%"),
        ("los", "did you mean 'loss'?"),
        ("supply/clock_jump:seconds=1s", "cannot inject clock_jump"),
    ],
)
def test_a_fault_without_its_device_is_told_in_one_line(tmp_path: Path, fault: str, told: str) -> None:
    assert told in refusal("--cell", str(cell(tmp_path)), "--fault", fault)


def test_a_cell_of_real_devices_wants_a_copy(tmp_path: Path) -> None:
    told = refusal("--cell", str(cell(tmp_path, "192.0.2.10")))
    assert "arm (192.0.2.10:" in told and "supply (192.0.2.10:" in told and "board" not in told
    assert f"add --write {tmp_path}/cell-emulated.yaml" in told


def test_the_copy_lies_beside_the_cell_and_is_not_the_cell(tmp_path: Path) -> None:
    file = cell(tmp_path)
    assert "beside" in refusal("--cell", str(file), "--write", str(tmp_path / "there" / "copy.yaml"))
    assert "the cell's own file" in refusal("--cell", str(file), "--write", str(file))


def test_a_fault_that_a_device_of_a_cell_refuses_is_told_with_the_reason(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(
        f"site: test\ncell: test\nsources: {{arm: {{driver: ur, host: 127.0.0.1, port: {free_port()}}}}}\n"
    )
    result = CliRunner().invoke(command, ["--cell", str(tmp_path / "one.yaml"), "--fault", "spring:joint=9"])
    assert str(result.exception) == "ur emulator: an emulated arm has joints 1 to 6, not 9"


def test_options_of_one_device_are_not_for_a_cell(tmp_path: Path) -> None:
    result = CliRunner().invoke(command, ["--cell", str(cell(tmp_path)), "--listen", "pty"])
    assert result.exit_code == 2 and "--listen is for one DRIVER" in result.output


async def test_the_devices_of_a_cell_run_in_one_world(tmp_path: Path) -> None:
    """One spring on all, what is asked of one source, and the end of all with the end of input."""
    file = cell(tmp_path)
    process = await started("--cell", str(file), "--control", "--fault", "spring:joint=3")
    ready = (await said(process))["ready"]
    settings = load(file).sources
    assert ready["arm"] == f"127.0.0.1:{settings['arm'].settings.port}"  # type: ignore[attr-defined]
    assert ready["board"] == f"{tmp_path}/board"
    assert await asked(process, fault="encoder:joint=2,offset=3deg") == {"ok": True}
    assert await asked(process, source="supply", fault="loss:probability=1%") == {"ok": True}
    assert await asked(process, source="board", fault="spring:joint=3") == {"ok": True}
    assert "joints 1 to 6, not 9" in str(await asked(process, source="supply", fault="spring:joint=9"))
    for order in ({"source": "bord", "fault": "loss"}, {"fault": "loss"}, {"source": "bord", "counts": True}):
        assert "arm, supply, board" in str((await asked(process, **order))["error"])
    assert "a fault in words" in str((await asked(process, source="arm", fault={"kind": "loss"}))["error"])
    assert await asked(process, fault="arm/message:text=hello") == {"ok": True}, "the others know no such fault"
    assert set((await asked(process, counts=True))["counts"]) == {"arm", "supply", "board"}
    await ends_with_its_input(process)
    assert not (tmp_path / "board").is_symlink()


async def test_the_copy_reads_the_emulators_and_says_all_else_as_it_was(tmp_path: Path) -> None:
    file = cell(tmp_path, "192.0.2.10")
    process = await started("--cell", str(file), "--write", str(tmp_path / "copy.yaml"), "--control")
    ready = (await said(process))["ready"]
    written = (tmp_path / "copy.yaml").read_text()
    copy = load(tmp_path / "copy.yaml")
    for name in ("arm", "supply"):
        device = copy.sources[name].settings
        assert ready[name] == f"{device.host}:{device.port}"  # type: ignore[attr-defined]
    assert ready["board"] == copy.sources["board"].settings.port  # type: ignore[attr-defined]
    assert written.startswith("site: test\ncell: test\nsources:\n  arm: {driver: ur, host: 127.0.0.1, port: ")
    process.send_signal(signal.SIGTERM)
    assert await asyncio.wait_for(process.wait(), PATIENCE) == 0


async def ends_with_its_input(process: asyncio.subprocess.Process) -> None:
    assert process.stdin is not None
    process.stdin.close()
    assert await asyncio.wait_for(process.wait(), PATIENCE) == 0


async def started(*arguments: str) -> asyncio.subprocess.Process:
    pipe = asyncio.subprocess.PIPE
    words = [sys.executable, "-m", "cellwatt.commands", "emulate", *arguments]
    return await asyncio.create_subprocess_exec(*words, stdin=pipe, stdout=pipe)


async def said(process: asyncio.subprocess.Process) -> dict[str, dict[str, str]]:
    assert process.stdout is not None
    found: dict[str, dict[str, str]] = json.loads(await asyncio.wait_for(process.stdout.readline(), PATIENCE))
    return found


async def asked(process: asyncio.subprocess.Process, **message: object) -> dict[str, object]:
    assert process.stdin is not None
    process.stdin.write(json.dumps(message).encode() + b"\n")
    answer: dict[str, object] = await said(process)  # type: ignore[assignment]
    return answer
