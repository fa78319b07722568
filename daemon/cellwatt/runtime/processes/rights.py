"""What the process that collects may claim of the host, so that others do not hold it up."""

from __future__ import annotations

import ctypes
import os
from typing import Final

REALTIME: Final = 10
"""Priority of real-time scheduling, of 1 to 99: above all that is not real-time, below the kernel's own threads."""
NICE: Final = -10
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def claim() -> str:
    """Take what the unit or the user allows, and say in one line what that is."""
    return f"{_scheduling()}, {_memory()}"


def _scheduling() -> str:
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(REALTIME))
    except OSError:
        pass
    else:
        return f"real-time scheduling at priority {REALTIME}"
    try:
        os.setpriority(os.PRIO_PROCESS, 0, min(NICE, os.getpriority(os.PRIO_PROCESS, 0)))
    except OSError:
        return "no right to real-time scheduling or a higher priority"
    return f"no right to real-time scheduling, nice {os.getpriority(os.PRIO_PROCESS, 0)}"


def _memory() -> str:
    libc = ctypes.CDLL(None, use_errno=True)
    # Only what is used is locked: the rings are larger than what they hold.
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f"memory not locked ({os.strerror(ctypes.get_errno())})"
    return "memory locked"
