"""No process is left behind by a command that starts others, however it ends."""

from __future__ import annotations

import asyncio
import json
import os
import select
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from tests.daemon.emulation.test_emulate import cell
from tests.patience import PATIENCE

pytestmark = pytest.mark.system


def descendants(pid: int) -> set[int]:
    """Process ids of all children of a process, and of theirs."""
    found: set[int] = set()
    for thread in Path(f"/proc/{pid}/task").iterdir():
        for child in map(int, (thread / "children").read_text().split()):
            found |= {child} | descendants(child)
    return found


def end_of_all(pids: set[int]) -> list[int]:
    """Wait for the end of all these processes; those that run on are killed and returned."""
    left = []
    for pid in pids:
        try:
            descriptor = os.pidfd_open(pid)
        except ProcessLookupError:
            continue
        try:
            if not select.select([descriptor], [], [], PATIENCE)[0]:
                left.append(pid)
                signal.pidfd_send_signal(descriptor, signal.SIGKILL)
        finally:
            os.close(descriptor)
    return left


@asynccontextmanager
async def running(*arguments: str) -> AsyncIterator[asyncio.subprocess.Process]:
    pipe = asyncio.subprocess.PIPE
    words = [sys.executable, "-m", "cellwatt.commands", *arguments]
    process = await asyncio.create_subprocess_exec(*words, stdout=pipe, stderr=pipe)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def line_with(text: str, stream: asyncio.StreamReader | None) -> None:
    assert stream is not None
    async with asyncio.timeout(PATIENCE):
        while text not in (line := (await stream.readline()).decode()):
            assert line, f"it never said {text!r}"


@pytest.mark.slow
@pytest.mark.timeout(240)
async def test_a_demo_leaves_nothing_running_and_tells_what_it_saw(tmp_path: Path) -> None:
    async with running("demo", "--seconds", "600", "--json", "--keep", str(tmp_path)) as demo:
        await line_with("the spring comes", demo.stderr)
        others = descendants(demo.pid)
        assert len(others) >= 6  # four devices, the daemon with its own, the subscriber
        demo.terminate()
        told, _ = await asyncio.wait_for(demo.communicate(), PATIENCE)
    assert await asyncio.to_thread(end_of_all, others) == []
    summary = json.loads(told)
    assert demo.returncode == 1 and not summary["ok"]
    assert summary["problems"][0] == "the demo was ended early: SIGTERM"
    assert summary["fault"] is None
    assert set(summary["sources"]) == {"arm", "board", "positioner", "mains"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=lambda n: n.name)
async def test_emulators_of_a_cell_end_with_it(number: signal.Signals, tmp_path: Path) -> None:
    async with running("emulate", "--cell", str(cell(tmp_path))) as emulating:
        await line_with("next, in another terminal: cellwatt run", emulating.stdout)
        devices = descendants(emulating.pid)
        assert len(devices) == 3
        emulating.send_signal(number)
        code = await asyncio.wait_for(emulating.wait(), PATIENCE)
    assert await asyncio.to_thread(end_of_all, devices) == []
    assert code == {signal.SIGINT: 130, signal.SIGKILL: -9}[number]


CHILD = """
import signal, subprocess, sys
from cellwatt.child import ends_with_parent
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts what runs in the background deaf to it
child = subprocess.Popen(["sleep", "3600"], preexec_fn=ends_with_parent(), stdout=subprocess.DEVNULL)
print(child.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGKILL], ids=lambda n: n.name)
async def test_a_child_ends_with_its_parent(number: signal.Signals) -> None:
    """As the process of a vendor's library, and a live explanation, do."""
    pipe = asyncio.subprocess.PIPE
    parent = await asyncio.create_subprocess_exec(sys.executable, "-c", CHILD, stdin=pipe, stdout=pipe)
    assert parent.stdout is not None
    child = int(await asyncio.wait_for(parent.stdout.readline(), PATIENCE))
    assert os.getpgid(child) == child  # a Ctrl-C is for the parent alone
    parent.send_signal(number)
    await asyncio.wait_for(parent.communicate(), PATIENCE)
    assert await asyncio.to_thread(end_of_all, {child}) == []
