"""docs/first-cell.md: its blocks, as they stand, in one shell of a user without rights, from a clone to an alarm."""

from __future__ import annotations

import os
import pwd
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, blocks

pytestmark = [pytest.mark.system, pytest.mark.slow, pytest.mark.timeout(600)]

NOBODY = "nobody"
INSTALL, *REST = [block.text for block in blocks("first-cell.md", "sh")]
PATH = "/usr/local/bin:/usr/bin:/bin"


@pytest.fixture
def place() -> Iterator[Path]:
    """A folder of the user who follows the page."""
    folder = Path(tempfile.mkdtemp(prefix="first-cell-", dir="/var/tmp"))  # pytest's own are closed to others
    yield folder
    shutil.rmtree(folder)


def stranger(alone: bool) -> list[str]:
    """Words before a command that make it that of a user without rights; ``alone``: on a network of its own."""
    if os.geteuid() != 0:
        return []
    if shutil.which("setpriv") is None:
        pytest.skip("root needs setpriv to become a user without rights")
    user = pwd.getpwnam(NOBODY)
    become = ["setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups", "--no-new-privs"]
    apart = ["unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"]
    able = shutil.which("ip") and subprocess.run([*apart, "true"], capture_output=True).returncode == 0
    return [*(apart if alone and able else []), *become]


def follow(page: list[str], place: Path, alone: bool = True) -> str:
    """Run blocks in one shell in the clone at ``place``; return what they print."""
    before = stranger(alone)
    if before:
        user = pwd.getpwnam(NOBODY)
        for path in (place, *place.rglob("*")):
            os.chown(path, user.pw_uid, user.pw_gid, follow_symlinks=False)
    home = {"HOME": str(place), "PATH": PATH, "LANG": "C.UTF-8"}
    shell = [*before, "bash", "-e", "-c", "trap 'kill $(jobs -p) 2>/dev/null || true' EXIT\n" + "\n".join(page)]
    done = subprocess.run(
        shell, cwd=place / "cellwatt", env=home, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def interpreter() -> str:
    """A Python of this version that the user without rights may run."""
    same = f"import sys; sys.exit(sys.version_info[:2] != {sys.version_info[:2]})"
    for python in (sys.executable, shutil.which("python3", path=PATH)):
        if python and subprocess.run([*stranger(False), "sh", "-c", f"{python} -c '{same}'; exit $?"]).returncode == 0:
            return python
    pytest.skip("no Python of this version may be run by a user without rights")


def check(said: str, folder: Path) -> None:
    """The page's promises, in order."""
    promised = (
        "cell.yaml: configuration is valid",
        r"arm +Universal Robots.* 500 Hz +\d+\.\d+ Hz .* (ok|warning)",
        r"task_1: 8 moves, \d+ cycles at speed 1\.00",
        r"error: Joint 3 works against a force .*; power differs by up to \d+ W",
        "plot.html",
    )
    at = 0
    for promise in promised:
        found = re.compile(promise).search(said, at)
        assert found is not None, f"{promise}: {said}"
        at = found.end()
    assert not re.search(r"error: Joint [^3]", said)
    assert "spring" not in (folder / "cell.yaml").read_text()
    assert "plotly" in (folder / "plot.html").read_text()
    assert next((folder / "tables").glob("*.csv")).stat().st_size > 10_000
    assert "Traceback" not in said + (folder / "daemon.log").read_text()


def test_the_page_as_it_stands(place):
    clone = place / "cellwatt"
    subprocess.run(["git", "clone", "-q", str(ROOT), str(clone)], check=True)
    follow([INSTALL], place, alone=False)
    check(follow(REST, place, alone=False), clone / "first-cell")


def test_the_page_with_this_installation(place):
    activate = place / "cellwatt" / ".venv" / "bin" / "activate"
    activate.parent.mkdir(parents=True)
    command = activate.with_name("cellwatt")
    command.write_text(f'#!/bin/sh\nexec {interpreter()} -m cellwatt.commands "$@"\n')
    command.chmod(0o755)
    installed = [path for path in sys.path if path.startswith(sysconfig.get_path("purelib"))]
    sources = [*(str(ROOT / name) for name in ("daemon", "drivers", "plugins")), *installed]
    activate.write_text(f"export PATH={activate.parent}:$PATH PYTHONPATH={':'.join(sources)}\n")
    check(follow(REST, place), place / "cellwatt" / "first-cell")
