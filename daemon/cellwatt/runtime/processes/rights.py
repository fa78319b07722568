"""Scheduling and memory rights that processes claim from the host, and memory that they return."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import logging
import os
import resource
from typing import Final

log = logging.getLogger(__name__)

REALTIME: Final = 10
"""Priority of real-time scheduling, 1 to 99: above all other programs, below the kernel's own threads."""
NICE: Final = -10
KEEPING_UP: Final = -5
"""Niceness of *align* and *tell*: beside busy programs, the ring must not run full."""
DESCRIPTORS: Final = 65_536
FEW: Final = 256
"""Smallest number of descriptors that a daemon needs."""
_M_ARENA_MAX: Final = -8
"""Parameter of ``mallopt``: number of heaps for the threads of a process; each takes a megabyte or two."""
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def claim() -> str:
    """For *collect*: claim the rights that the unit or the user allows; return them in one line."""
    return f"{_scheduling()}, {_memory()}"


def keep_up(process: int = 0) -> None:
    """For *align* and *tell*: take priority over other programs, if the unit or the user allows it.

    ``process``: its number, 0 for the caller; threads that the process has already started are not changed.
    """
    with contextlib.suppress(OSError):
        _prefer(KEEPING_UP, process)


def allow_descriptors() -> None:
    """For all processes: raise the limit of open files and connections as far as allowed, up to 65,536.

    Zenoh accepts connections that stay silent for 10 s, in the process that records: the usual 1024 are soon used.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, DESCRIPTORS)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, most), hard))
    if most < FEW:
        log.warning("only %d files and connections may be open (ulimit -n): the daemon needs %d at least", most, FEW)


def settle_memory() -> None:
    """Return the memory used by the start, and exclude the present objects from garbage collection."""
    gc.collect()
    gc.freeze()
    libc = ctypes.CDLL(None)
    with contextlib.suppress(AttributeError):  # another C library than GNU's
        libc.mallopt(_M_ARENA_MAX, 1)
        libc.malloc_trim(0)


def _scheduling() -> str:
    try:
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(REALTIME))
    except OSError:
        pass
    else:
        return f"real-time scheduling at priority {REALTIME}"
    try:
        _prefer(NICE)
    except OSError:
        return "no right to real-time scheduling or a higher priority"
    return f"no right to real-time scheduling, nice {os.getpriority(os.PRIO_PROCESS, 0)}"


def _prefer(nice: int, process: int = 0) -> None:
    os.setpriority(os.PRIO_PROCESS, process, min(nice, os.getpriority(os.PRIO_PROCESS, process)))


def _memory() -> str:
    libc = ctypes.CDLL(None, use_errno=True)
    # Only used pages are locked: the rings reserve more memory than they use.
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f"memory not locked ({os.strerror(ctypes.get_errno())})"
    return "memory locked"
