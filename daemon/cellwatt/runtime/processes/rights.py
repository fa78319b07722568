"""Rights that processes claim of the host so that others do not hold them up, and memory that they give back."""

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
"""Priority of real-time scheduling, of 1 to 99: above all that is not real-time, below the kernel's own threads."""
NICE: Final = -10
KEEPING_UP: Final = -5
"""Niceness of who aligns, records and tells: beside busy programs of others, the ring must not run full."""
DESCRIPTORS: Final = 65_536
FEW: Final = 256
"""Descriptors below which a daemon may not be able to do its work."""
_M_ARENA_MAX: Final = -8
"""Of ``mallopt``: heaps that the threads of a process may have; each takes a megabyte or two."""
_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4


def claim() -> str:
    """For who collects: take what the unit or the user allows, and say in one line what that is."""
    return f"{_scheduling()}, {_memory()}"


def keep_up(process: int = 0) -> None:
    """For who aligns, records and tells: go before other programs, where the unit or the user allows it.

    ``process``: its number, 0 for the one that calls; one that has made threads already keeps theirs as they are.
    """
    with contextlib.suppress(OSError):
        _prefer(KEEPING_UP, process)


def allow_descriptors() -> None:
    """For all processes: have as many files and connections open as the unit or the user allows, up to 65,536.

    Zenoh accepts connections that say nothing for 10 s, in the process that records: the usual 1024 are soon taken.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, DESCRIPTORS)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, most), hard))
    if most < FEW:
        log.warning("only %d files and connections may be open (ulimit -n): the daemon needs %d at least", most, FEW)


def settle_memory() -> None:
    """Give back what the start has used, and never look for garbage again among what is there now."""
    gc.collect()
    gc.freeze()
    libc = ctypes.CDLL(None)
    with contextlib.suppress(AttributeError):  # another library of C than GNU's
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
    # Only what is used is locked: the rings are larger than what they hold.
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT):
        return f"memory not locked ({os.strerror(ctypes.get_errno())})"
    return "memory locked"
