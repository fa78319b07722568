"""Fails a test in which the daemon holds up its event loop, by a call that blocks or by computing."""

from __future__ import annotations

import asyncio
import gc
import inspect
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from blockbuster import BlockBuster, BlockingError, blockbuster

LIMIT = 0.15
"""s of computing that one step on a loop may take: of its own thread, so that a busy machine changes nothing."""

LOOP = str(Path(asyncio.__file__).parent)
OURS = tuple(str(Path(__file__).parents[1] / folder) for folder in ("daemon", "drivers", "plugins"))
SHORT = [
    ("time.sleep", "franka/emulator.py", "_keep_apart"),  # below a millisecond, which the loop's own timers cannot
    ("socket.socket.sendto", "can_sensor/emulator.py", "_send"),  # one datagram
    ("socket.socket.recvmsg", "can_sensor/listening.py", "drain"),  # python-can looks first whether there is a frame
    ("threading.Lock.acquire", "coverage/collector.py", "lock_data"),  # where coverage is measured
]

_held_up: list[str] = []
_step: tuple[Any, int, float] | None = None
"""What runs on a loop now, in which thread, and since when."""
_seen: tuple[Any, str] | None = None
"""The step in which the daemon was seen to compute for long, and its stack then."""
_handle_run = asyncio.Handle._run  # type: ignore[attr-defined]
_collecting = [0.0, 0.0]
"""s of computing when a collection of garbage began, s of all of them."""


@pytest.fixture(scope="session", autouse=True)
def _calls_that_block() -> BlockBuster:
    """All of them; those on files only where we call them, since a test may look at the few of its own."""
    found = BlockBuster()
    for call, file, function in SHORT:
        found.functions[call].can_block_in(file, function)
    for name, function in found.functions.items():
        if name.startswith(("os.", "io.")):
            function.can_block_in("logging/__init__.py", {"emit", "flush"})
            may = function.can_block_predicate
            function.can_block_predicate = lambda *a, may=may, **k: may(*a, **k) or not _ours(inspect.currentframe())
    return found


@pytest.fixture(scope="session", autouse=True)
def _steps_timed() -> Iterator[None]:
    over = threading.Event()
    watch = threading.Thread(target=_look, args=(over,), name="watch over loops")
    watch.start()
    gc.callbacks.append(_count)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(asyncio.Handle, "_run", _timed)
        patch.setattr(blockbuster, "BlockingError", _Told)
        yield
    gc.callbacks.remove(_count)
    over.set()
    watch.join()


@pytest.fixture(autouse=True)
def _loop_goes_on(request: pytest.FixtureRequest, _calls_that_block: BlockBuster) -> Iterator[None]:
    _held_up.clear()
    on_purpose = request.node.get_closest_marker("blocks_loop")
    if on_purpose:
        _calls_that_block.deactivate()
    else:
        _calls_that_block.activate()
    yield
    if _held_up and not on_purpose:
        pytest.fail("held up its event loop:\n" + "\n".join(_held_up), pytrace=False)


class _Told(BlockingError):
    """Kept as well as raised: who calls may pass it over as an error like others."""

    def __init__(self, function: str) -> None:
        super().__init__(function)
        _held_up.append(f"{self}, called from\n" + "".join(traceback.format_stack(limit=6)[:-2]))


def _ours(frame: FrameType | None) -> bool:
    """Whether what the loop runs is of the daemon: not of a test, nor of an emulator, which is alone.

    The innermost coroutine says so, or else what the loop has called.
    """
    file = ""
    while frame and frame.f_code is not _timed.__code__:
        coroutine = frame.f_code.co_flags & (inspect.CO_COROUTINE | inspect.CO_ASYNC_GENERATOR)
        if coroutine or not frame.f_code.co_filename.startswith(LOOP):
            file = frame.f_code.co_filename
        frame = None if coroutine else frame.f_back
    return file.startswith(OURS) and not file.endswith("emulator.py") and "/cellwatt/testing/" not in file


def _timed(handle: Any) -> None:
    global _step
    modules, collected, began = len(sys.modules), _collecting[1], time.thread_time()
    _step = handle, threading.get_ident(), time.monotonic()
    _handle_run(handle)
    _step = None
    took = time.thread_time() - began - (_collecting[1] - collected)
    # Who comes first imports what all others find imported; garbage may be that of all others.
    if took > LIMIT and len(sys.modules) == modules and _seen and _seen[0] is handle:
        _held_up.append(f"computing for {took:.2f} s, at\n{_seen[1]}")


def _look(over: threading.Event) -> None:
    """Notes where the daemon is in a step that goes on."""
    global _seen
    while not over.wait(LIMIT / 4):
        step = _step
        if step and time.monotonic() - step[2] > LIMIT / 4:
            frame = sys._current_frames().get(step[1])
            if _step is step and _ours(frame):
                _seen = step[0], "".join(traceback.format_stack(frame, limit=4))


def _count(phase: str, _: dict[str, int]) -> None:
    now = time.thread_time()
    if phase == "start":
        _collecting[0] = now
    else:
        _collecting[1] += now - _collecting[0]
