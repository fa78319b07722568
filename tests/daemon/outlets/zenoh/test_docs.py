"""The programs of docs/zenoh.md and docs/alarms.md, run as they are printed."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tests.daemon.outlets.zenoh.processes import ROOT, Child, free_port
from tests.docs.pages import blocks
from tests.patience import PATIENCE, wait_until


def programs(page: str) -> list[str]:
    """Return the Python programs of a page."""
    return [block.text for block in blocks(page, "python")]


PROGRAMS = {
    "subscriber": (programs("zenoh.md")[0], r"raw/arm/samples \d+ \[|needs more power"),
    "plain": (programs("zenoh.md")[1], r"\d{19} \{'joint_1.position \[rad\]': \d+\.\d"),
    "alarms": (programs("alarms.md")[0], r"raised joint_fault Joint \d+ needs more power"),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_program_of_the_docs_runs(name: str, tmp_path: Path) -> None:
    text, expected = PROGRAMS[name]
    found = re.compile(expected).search
    port = free_port()
    program = tmp_path / "program.py"
    program.write_text(text.replace("7447", str(port)))
    with Child("cell_process", listen=[f"tcp/127.0.0.1:{port}"]) as cell:
        samples = int(2 * PATIENCE * 500.0)  # for as long as anybody may wait for one
        cell.ready().send(stream={"samples": samples, "frames_too": False, "every": 5, "rate": 500.0, "block": 5})
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


def test_the_plain_program_needs_nothing_of_ours() -> None:
    text = PROGRAMS["plain"][0]
    imports = [line for line in text.splitlines() if "import" in line]
    assert imports == ["import json, pyarrow as pa, zenoh"]
    assert len([line for line in text.splitlines() if line.strip()]) <= 15


def test_every_setting_is_in_the_docs() -> None:
    from cellwatt.outlets.zenoh import ZenohSettings

    text = (ROOT / "docs" / "zenoh.md").read_text()
    table = text[text.index("## Settings") : text.index("## What can be lost")]
    assert set(re.findall(r"`(\w+)`", table)) >= set(ZenohSettings.model_fields)


def test_every_field_of_an_alarm_is_in_the_docs() -> None:
    from schemas import schemas

    text = (ROOT / "docs" / "alarms.md").read_text()
    assert set(re.findall(r"`(\w+)`", text)) >= set(schemas()["alarm"]["properties"])
