"""A stranger explains an arm of his own by the command of docs/simulators/mujoco.md, in a real terminal."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, blocks

pytest.importorskip("mujoco")
ARM = ROOT.parent / "shared" / "first_try"
"""An arm of four joints in MuJoCo: on the real one 9 Nm of friction at joint 2 instead of 5, and 2 kg at the flange."""
HERE = f"run by {Path(__file__).relative_to(ROOT)}"
MINUTES = 10


def typed(command: str, folder: Path, seconds: float) -> tuple[int, str]:
    """Run a command in a terminal in which nobody answers; return its exit code and what it shows."""
    ours, theirs = pty.openpty()
    environment = {**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen(
        ["sh", "-c", command], cwd=folder, env=environment, stdin=theirs, stdout=theirs, stderr=theirs
    )
    os.close(theirs)
    end, shown = time.monotonic() + seconds, b""
    try:
        while time.monotonic() < end:
            if select.select([ours], [], [], 1.0)[0]:
                try:
                    shown += os.read(ours, 65536)
                except OSError:  # the other side is closed
                    return process.wait(), shown.decode()
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    raise AssertionError(f"no end after {seconds:.0f} s; a question? {shown.decode()}")


@pytest.mark.slow
@pytest.mark.timeout(MINUTES * 60)
@pytest.mark.skipif(not ARM.exists(), reason="the arm is not here")
def test_an_arm_of_ones_own_is_explained_by_the_pages_command(tmp_path: Path) -> None:
    shutil.copy(ARM / "arm.xml", tmp_path)
    for number in (1, 2):
        shutil.copy(ARM / f"real_{number}.csv", tmp_path / f"run_{number}.csv")
    program = tmp_path / "cellwatt"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m cellwatt.commands "$@"\n')
    program.chmod(0o755)
    [block] = [block for block in blocks("simulators/mujoco.md", "sh") if block.note == HERE]
    code, shown = typed(block.text, tmp_path, MINUTES * 60 - 30)
    assert code == 0, shown
    numbers = dict(re.findall(r"^  (Payload: mass|Coulomb friction \(joint 2\)) .*?([\d.]+) ± ", shown, re.MULTILINE))
    assert float(numbers["Payload: mass"]) == pytest.approx(2.0, abs=0.2)
    assert float(numbers["Coulomb friction (joint 2)"]) == pytest.approx(9.0, abs=0.5)
    assert {path.name for path in (tmp_path / "result").iterdir()} >= {"report.html", "arm.mended.xml"}


def test_a_question_that_nobody_answers_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="a question"):
        typed("read answer", tmp_path, 1.0)
    assert typed("test -t 0 && echo asked of nobody", tmp_path, 20.0)[1].strip() == "asked of nobody"
