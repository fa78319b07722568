"""Child processes that end with their parent, even if the parent is killed."""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from cellwatt.errors import CellwattError

MODULE: Final = (sys.executable, "-P", "-m")
"""First words of the command of a child that runs a module; files of the present folder do not count as modules."""
_PR_SET_PDEATHSIG: Final = 1
_libc = ctypes.CDLL(None, use_errno=True)


def ends_with_parent(number: signal.Signals = signal.SIGTERM, niceness: int = 0) -> Callable[[], None]:
    """Return a ``preexec_fn`` for a child: the kernel sends it a signal when this process ends, by SIGKILL too.

    The child has at least this ``niceness``, with 0 that of its parent. It leads its own process group, so that
    Ctrl-C reaches only the parent, which ends the child in order. The thread that starts the child must outlive it.
    """
    parent = os.getpid()

    def tie() -> None:
        os.setpgid(0, 0)
        if niceness:
            os.setpriority(os.PRIO_PROCESS, 0, max(niceness, os.getpriority(os.PRIO_PROCESS, 0)))
        end_with(parent, number)

    return tie


def end_with(parent: int, number: signal.Signals = signal.SIGTERM) -> None:
    """Let the kernel send this process a signal when its ``parent`` ends."""
    _libc.prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)
    if os.getppid() != parent:  # the parent has ended meanwhile
        os._exit(1)


async def output(
    words: Sequence[str],
    limit: float,
    niceness: int,
    *,
    folder: Path | None = None,
    given: bytes = b"",
    heard: Callable[[str], object] = len,
) -> str:
    """Run ``python -m WORDS`` in ``folder`` with ``given`` as its standard input; return its standard output.

    ``heard`` is called with each line of its standard error.

    Raises ``CellwattError`` if it cannot be started, takes longer than ``limit`` s, or fails (with its last line).
    """
    pipe = asyncio.subprocess.PIPE
    try:
        process = await asyncio.create_subprocess_exec(
            *MODULE,
            *words,
            cwd=folder,
            stdin=pipe,
            stdout=pipe,
            stderr=pipe,
            preexec_fn=ends_with_parent(signal.SIGKILL, niceness),
        )
    except OSError as error:
        raise CellwattError(f"{words[0]} cannot be started: {error.strerror}") from error
    assert process.stdin is not None and process.stdout is not None and process.stderr is not None
    process.stdin.write(given)
    process.stdin.close()
    try:
        async with asyncio.timeout(limit):
            printed, last = await asyncio.gather(process.stdout.read(), _last(process.stderr, heard))
            await process.wait()
    except TimeoutError:
        raise CellwattError(f"it took longer than {limit:.0f} s") from None
    finally:
        await ended(process, 0.0)
    code = process.returncode or 0
    if code < 0:
        raise CellwattError(f"it was ended by {signal.Signals(-code).name}")
    if code:
        raise CellwattError(last.removeprefix("cellwatt: ") or f"it ended with {code}")
    return printed.decode(errors="replace").strip()


async def ended(process: asyncio.subprocess.Process, patience: float) -> None:
    """Wait up to ``patience`` s for the end of a child; then kill it."""
    # Do not signal a process that has ended: the signal reaps it, and asyncio's child watcher misses its exit.
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(process.wait(), patience)
    if process.returncode is None:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


async def _last(stream: asyncio.StreamReader, heard: Callable[[str], object]) -> str:
    """Call ``heard`` with each line of ``stream``; return the last one."""
    last = ""
    async for line in stream:
        last = line.decode(errors="replace").strip() or last
        heard(last)
    return last
