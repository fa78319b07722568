"""Child processes that end with their parent, however that ends."""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Callable
from typing import Final

_PR_SET_PDEATHSIG: Final = 1
_libc = ctypes.CDLL(None, use_errno=True)


def ends_with_parent(number: signal.Signals = signal.SIGTERM, niceness: int = 0) -> Callable[[], None]:
    """Return a ``preexec_fn`` for a child: the kernel sends it a signal when this process ends, by SIGKILL too.

    The child gives way to others by ``niceness``. It leads a process group of its own, so that a Ctrl-C is for the
    parent, which ends it in order. The thread that starts it must live as long as the process.
    """
    parent = os.getpid()

    def tie() -> None:
        os.setpgid(0, 0)
        os.nice(niceness)
        end_with(parent, number)

    return tie


def end_with(parent: int, number: signal.Signals = signal.SIGTERM) -> None:
    """Let the kernel send this process a signal when its ``parent`` ends."""
    _libc.prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)
    if os.getppid() != parent:  # it has ended meanwhile
        os._exit(1)
