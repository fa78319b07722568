"""Consumers that hang or die, and how processes end."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.daemon.outlets.zenoh.processes import ROOT, Child, free_port
from tests.daemon.outlets.zenoh.test_link_cut import (
    assert_complete,
    reached,
    received,
    start_consumer,
)
from tests.docs.pages import blocks
from tests.patience import PATIENCE, wait_until


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def cell(port: int) -> Iterator[Child]:
    """A cell that publishes at the port."""
    with Child("cell_process", listen=[f"tcp/127.0.0.1:{port}"]) as child:
        yield child.ready()


def account(cell: Child) -> dict[str, Any]:
    cell.said.clear()
    cell.send(account=True)
    return cell.wait_for(lambda s: "account" in s, "account")["account"]


def test_a_consumer_that_is_frozen_holds_up_neither_the_cell_nor_another_consumer(cell: Child, port: int) -> None:
    with start_consumer(port) as frozen, start_consumer(port) as other:
        os.kill(frozen.pid, signal.SIGSTOP)
        try:
            # Enough to fill every buffer on the way to the frozen one.
            cell.send(stream={"samples": 120_000, "frames_too": True, "every": 10, "rate": 40_000.0, "block": 200})
            cell.wait_for(lambda s: "published" in s, "published")
            wait_until(lambda: reached(other, "raw/arm/samples", 120_000), "all of it at the other one")
        finally:
            os.kill(frozen.pid, signal.SIGCONT)
        assert_complete(received(other, "raw/arm/samples"), 0, 120_000)
        # Once thawed it gets all of it too.
        wait_until(lambda: reached(frozen, "raw/arm/samples", 120_000), "all of it at the frozen one")
        assert_complete(received(frozen, "raw/arm/samples"), 0, 120_000)
        figures = account(cell)
        assert figures["dropped"] == {}
        assert figures["residue"] == 0
        assert figures["received"] == 120_000 + 600 + 60


PROGRAMS = {
    "an exception ends the program inside the context": """
with Subscriber(SITE, CELL, link) as cell:
    cell.receive(PATIENCE)
    raise SystemExit(7)
""",
    "asyncio ends by an exception while a task reads": """
async def main():
    async with Subscriber(SITE, CELL, link) as cell:
        async def forever():
            async for message in cell:
                pass
        task = asyncio.create_task(forever())
        await asyncio.sleep(0.1)
        raise SystemExit(7)
asyncio.run(main())
""",
    "work goes to a spawned process while the session is open": """
if __name__ == "__main__":
    with Subscriber(SITE, CELL, link) as cell:
        cell.receive(PATIENCE)
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            assert pool.submit(abs, -3).result(PATIENCE) == 3
        cell.receive(PATIENCE)
    raise SystemExit(7)
""",
}
HEAD = """
import asyncio, multiprocessing, os, threading
from concurrent.futures import ProcessPoolExecutor
from cellwatt.subscriber import LinkSettings, Subscriber
SITE, CELL, PATIENCE = "plant-1", "weld-3", {patience}
link = LinkSettings(mode="client", connect=("tcp/127.0.0.1:{port}",))
"""


@pytest.mark.usefixtures("cell")
@pytest.mark.parametrize("name", PROGRAMS)
def test_no_program_hangs_at_its_end(name: str, port: int, tmp_path: Any) -> None:
    program = tmp_path / "program.py"
    program.write_text(HEAD.format(port=port, patience=PATIENCE) + PROGRAMS[name])
    done = subprocess.run(
        [sys.executable, str(program)], cwd=ROOT, timeout=PATIENCE, capture_output=True, text=True, check=False
    )
    assert done.returncode == 7, done.stderr


@pytest.mark.parametrize("module", ["outlets.zenoh.messages", "outlets.metrics.serving", "outlets.page.serving"])
def test_what_others_need_of_the_outlet_is_light(module: str) -> None:
    """The processes that serve metrics and the page encode messages, and do not publish: 5 MB less for each."""
    heavy = ("zenoh", "cellwatt.outlets.zenoh.outlet", "cellwatt.outlets.zenoh.answers")
    program = f"import sys, cellwatt.{module}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], timeout=PATIENCE, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_idle_outlet_is_small_and_does_not_load_arrow() -> None:
    """A daemon whose devices are all down must stay small."""
    program = """
import asyncio, sys
from cellwatt.outlets.zenoh import ZenohSettings, ZenohOutlet
from tests.daemon.outlets.zenoh.fake_cell import FakeView, alarm
async def main():
    outlet = ZenohOutlet("zenoh", ZenohSettings(), FakeView())
    task = asyncio.create_task(outlet.run())
    while not outlet.account.received:
        outlet.offer(alarm(1))
        outlet.health({})
        await asyncio.sleep(0.01)
    task.cancel()
    await asyncio.wait([task])
    assert "pyarrow" not in sys.modules
asyncio.run(main())
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=PATIENCE, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr


# The programs of docs/outlets/zenoh.md and docs/alarms.md, run as they are printed ---


def programs(page: str) -> list[str]:
    """Return the Python programs of a page."""
    return [block.text for block in blocks(page, "python")]


PRINTED = {
    "subscriber": (programs("outlets/zenoh.md")[0], r"raw/arm/samples \d+ \[|needs more power"),
    "plain": (programs("outlets/zenoh.md")[1], r"\d{19} \{'joint_1.position \[rad\]': \d+\.\d"),
    "alarms": (programs("alarms.md")[0], r"raised joint_fault Joint \d+ needs more power"),
}


@pytest.mark.parametrize("name", PRINTED)
def test_program_of_the_docs_runs(name: str, cell: Child, port: int, tmp_path: Path) -> None:
    text, expected = PRINTED[name]
    found = re.compile(expected).search
    program = tmp_path / "program.py"
    program.write_text(text.replace("7447", str(port)))
    samples = int(2 * PATIENCE * 500.0)  # for as long as anybody may wait for one
    cell.send(stream={"samples": samples, "frames_too": False, "every": 5, "rate": 500.0, "block": 5})
    command = [sys.executable, "-u", str(program)]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        lines: list[str] = []
        reader = threading.Thread(target=lambda: lines.extend(iter(run.stdout.readline, "")))  # type: ignore[union-attr]
        reader.start()
        try:
            # Of the alarms half are over from the first: one of those may come before.
            wait_until(lambda: any(map(found, list(lines))) or run.poll() is not None, f"a line like {expected}")
        finally:
            run.kill()
            reader.join()
        assert any(map(found, lines)), run.stderr.read() if run.stderr else ""
        assert found(lines[0]) or name == "alarms", lines[0]


def test_every_setting_is_in_the_docs() -> None:
    from cellwatt.outlets.zenoh import ZenohSettings

    text = (ROOT / "docs" / "outlets" / "zenoh.md").read_text()
    table = text[text.index("## Settings") : text.index("## On a network")]
    assert set(re.findall(r"`(\w+)`", table)) >= set(ZenohSettings.model_fields)


def test_every_field_of_an_alarm_is_in_the_docs() -> None:
    from release.schemas import schemas

    text = (ROOT / "docs" / "alarms.md").read_text()
    assert set(re.findall(r"`(\w+)`", text)) >= set(schemas()["alarm"]["properties"])
