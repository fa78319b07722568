"""Fails a test that leaves a task, a thread, a process, a socket, a temporary folder or a quieted log behind."""

from __future__ import annotations

import asyncio
import gc
import logging
import os
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.patience import FACTOR

GRACE = 5.0 * FACTOR
"""s that a thread or a process has which is ending already; only a test that fails waits so long."""

TRACKER = "multiprocessing.resource_tracker"
"""Python's own, started by the first spawned process and kept to its own end."""

UNANSWERED = "/pymodbus/server/requesthandler.py"
"""A task of pymodbus's server, which forgets what it is about to answer when it is shut down."""

Left = dict[object, str]
"""What is there now, in words."""

_tasks: list[str] = []
_close = asyncio.Runner.close


def _close_and_tell(runner: asyncio.Runner) -> None:
    # The runner itself cancels what is left, and says nothing.
    loop = runner._loop  # type: ignore[attr-defined]
    if loop is not None and not loop.is_closed():
        left = map(repr, asyncio.all_tasks(loop))
        _tasks.extend(task for task in left if UNANSWERED not in task)
    _close(runner)


@pytest.fixture(scope="session", autouse=True)
def _of_the_session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder for temporary files that nobody else writes to; runners that tell what they cancel."""
    folder = str(tmp_path_factory.mktemp("temporary"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", folder)
        patch.setattr(tempfile, "tempdir", folder)
        patch.setattr(asyncio.Runner, "close", _close_and_tell)
        yield


@pytest.fixture(autouse=True)
def _nothing_is_left_behind(_of_the_session: None, request: pytest.FixtureRequest) -> Iterator[None]:
    if request.node.get_closest_marker("leaves_behind"):
        yield
        return
    _tasks.clear()
    before = present()
    yield
    end = time.monotonic() + GRACE
    while left := {what: words for what, words in present().items() if what not in before}:
        gc.collect()
        if time.monotonic() > end:
            break
        time.sleep(0.01)
    words = [f"task {task}" for task in _tasks] + list(left.values())
    if words:
        pytest.fail("left behind:\n" + "\n".join(words), pytrace=False)


def present() -> Left:
    """Threads, children, sockets, temporary files and quieted logs of this process."""
    return threads() | children() | sockets() | temporary() | levels()


def threads() -> Left:
    return {
        thread: f"thread {thread.name!r} ({type(thread).__qualname__})"
        for thread in threading.enumerate()
        if not isinstance(thread, threading._DummyThread)  # of a library, which once called back
    }


def children() -> Left:
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:  # the usual case, told by one system call
        return {}
    commands = {child: _command(child) for child in psutil.Process().children()}
    return {child: f"process {child.pid} {command}" for child, command in commands.items() if TRACKER not in command}


def _command(child: psutil.Process) -> str:
    try:
        return " ".join(child.cmdline()) or child.name()
    except psutil.Error:
        return "that ended just now"


def sockets() -> Left:
    found: Left = {}
    for number in os.listdir("/proc/self/fd"):  # noqa: PTH208 (its entries go while they are looked at)
        try:
            target = os.readlink(f"/proc/self/fd/{number}")  # noqa: PTH115
        except OSError:
            continue
        if target.startswith("socket:"):
            found[target] = f"{target} at file descriptor {number}"
    return found


def temporary() -> Left:
    paths = Path(tempfile.gettempdir()).iterdir()
    return {path: f"temporary {path}" for path in paths if path.name != ".ses"}  # of onnxruntime, one for all runs


def levels() -> Left:
    """Our loggers that have a level of their own: the tests after it would not see what is logged."""
    return {
        f"{name} at {logger.level}": f"level {logger.level} of the log {name}"
        for name, logger in logging.root.manager.loggerDict.copy().items()
        if name.startswith("cellwatt") and isinstance(logger, logging.Logger) and logger.level
    }
