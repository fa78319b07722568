"""Tests that leave something behind or hold up their loop, run with what holds for every test here."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

HERE = Path(__file__).parent

HEAD = """
import asyncio, socket, subprocess, sys, tempfile, threading, time
from tests.blocked_loop import OURS
kept = []
COMPUTES = '''
async def computes():
    end = time.thread_time() + 0.3
    while time.thread_time() < end:
        pass
'''
"""

CLEAN = """
async def test_clean(tmp_path):
    exec(COMPUTES.replace("async ", "") + "computes()", {"time": time})  # of the test itself
    await asyncio.create_task(asyncio.sleep(0))
    server = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
    server.close()
    await server.wait_closed()
    await asyncio.to_thread(time.sleep, 0.2)
    (tmp_path / "file").write_text("its own")
    with tempfile.TemporaryDirectory(), socket.socket():
        child = await asyncio.create_subprocess_exec(sys.executable, "-c", "")
        assert await child.wait() == 0
"""

WRONG = {
    "test_task": (
        """
async def test_task():
    kept.append(asyncio.create_task(asyncio.sleep(3600), name="forgotten"))
""",
        r"left behind:\ntask <Task pending name='forgotten'",
    ),
    "test_thread": (
        """
def test_thread():
    kept.append(threading.Event())
    threading.Thread(target=kept[-1].wait, name="forgotten", daemon=True).start()
""",
        r"left behind:\nthread 'forgotten'",
    ),
    "test_process": (
        """
def test_process():
    kept.append(subprocess.Popen([sys.executable, "-c", "input() or 'forgotten'"], stdin=subprocess.PIPE))
""",
        r"left behind:\nprocess \d+ .*forgotten",
    ),
    "test_socket": (
        """
def test_socket():
    kept.append(socket.create_server(("127.0.0.1", 0)))
""",
        r"left behind:\nsocket:\[\d+\] at file descriptor \d+",
    ),
    "test_folder": (
        """
def test_folder():
    tempfile.mkdtemp(prefix="forgotten")
""",
        r"left behind:\ntemporary \S*/forgotten",
    ),
    "test_sleep": (
        """
async def test_sleep():
    try:
        time.sleep(0.2)
    except Exception:
        pass
""",
        r"held up its event loop:\nBlocking call to time\.sleep",
    ),
    "test_computing": (
        """
async def test_computing():
    ours = {"time": time}
    exec(compile(COMPUTES, OURS[0] + "/computes.py", "exec"), ours)
    await ours["computes"]()
""",
        r"held up its event loop:\ncomputing for 0\.\d+ s",
    ),
}


def test_what_is_left_is_named_and_fails_its_test(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(HERE.parent))
    monkeypatch.setenv("CELLWATT_TEST_PATIENCE", "0.1")  # for what is left there is nothing to wait for
    pytester.makepyprojecttoml((HERE.parent / "pyproject.toml").read_text())
    pytester.makeconftest((HERE / "conftest.py").read_text())
    pytester.makepyfile(HEAD + CLEAN + "".join(text for text, _ in WRONG.values()))
    done = pytester.runpytest_subprocess(pytester.path)
    said = done.stdout.str()
    done.assert_outcomes(passed=1 + len(WRONG), errors=len(WRONG))
    for name, (_, words) in WRONG.items():
        found = re.search(rf"ERROR at teardown of {name} _+\n((.|\n)*?)\n(____|====)", said)
        assert found and re.match(words, found[1]), said
