"""Processor time of processes: how long a process waited for a core, and whether it is starved."""

from __future__ import annotations

import math
import os
import time
from typing import Final

_STEAL: Final = 8
"""Index, in a core's line of /proc/stat (proc_stat(5)), of the time that the hypervisor gave to other machines."""
_JIFFY_NS: Final = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
_LINE: Final = 128
"""Largest length of a core's line in bytes, in practice."""
_STEP: Final = 0.005  # s
_open: dict[str, int] = {}
"""Descriptors by path; a descriptor that the parent opened before a fork has another path than our own."""


class RunDelay:
    """Measures the waiting time of a process's first thread; one ``look`` takes about 4 µs."""

    def __init__(self) -> None:
        self._ready, self._stolen = _ready_ns(), _steal.now()

    def look(self) -> int:
        """Time since the last call, ns, for which the thread was ready but did not run, or a core was withheld.

        Withheld time counts in steps of 10 ms, and only if /proc/stat can be read.
        """
        ready, stolen = self._ready, self._stolen
        self._ready, self._stolen = _ready_ns(), _steal.now()
        away = (now - before for now, before in zip(self._stolen, stolen, strict=False))
        # Not their sum: a thread that is ready on a core which the hypervisor keeps counts in both.
        return max(self._ready - ready, *away, 0)


def _ready_ns() -> int:
    """Time for which this process's first thread was ready but did not run, ns; 0 if the kernel does not count it."""
    text = _read(f"/proc/{os.getpid()}/schedstat", _LINE)
    return int(text.split()[1]) if text else 0


class _Steal:
    """Time for which the hypervisor withheld each core; read at most once in 5 ms."""

    def __init__(self) -> None:
        self._at = -math.inf
        self._found: tuple[int, ...] = ()

    def now(self) -> tuple[int, ...]:
        """Withheld time by core, ns, in steps of 10 ms; empty if none, or if unknown."""
        at = time.monotonic()
        if at - self._at > _STEP:
            self._at, self._found = at, _stolen_ns()
        return self._found


def _stolen_ns() -> tuple[int, ...]:
    text = _read("/proc/stat", _LINE * (1 + (os.cpu_count() or 1)))
    cores = text.split(b"\n")
    if not text or int(cores[0].split()[_STEAL]) == 0:
        return ()
    return tuple(int(core.split()[_STEAL]) * _JIFFY_NS for core in cores[1:] if core.startswith(b"cpu"))


def _read(path: str, size: int) -> bytes:
    if path not in _open:
        try:
            _open[path] = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError:
            _open[path] = -1
    return os.pread(_open[path], size, 0) if _open[path] >= 0 else b""


_steal = _Steal()


SHARE: Final = 0.5
"""Share of a processor: a process that is ready to run and gets less since its last sign of life is starved."""
_STAT_LINE: Final = 1024
"""Largest length of /proc/PID/stat in bytes."""
_TICK: Final = 1 / os.sysconf("SC_CLK_TCK")  # s
_STATE, _USER, _SYSTEM = 0, 11, 12
"""Fields of /proc/PID/stat after the name."""


def spent(process: int) -> float:
    """Processor time, s, that the process with this number has used so far; 0 if it has ended."""
    return _seen(process)[1]


def starved(process: int, before: float, silent: float) -> bool:
    """True if a process waits for a processor or the disk, and has hardly run in the last ``silent`` s.

    ``process`` is its number, ``before`` the processor time, s, that it had used ``silent`` s ago.
    """
    state, taken = _seen(process)
    return state in ("R", "D") and taken - before < SHARE * silent


def _seen(process: int) -> tuple[str, float]:
    try:
        file = os.open(f"/proc/{process}/stat", os.O_RDONLY | os.O_CLOEXEC)  # in memory: no wait for a disk
    except OSError:
        return "", 0.0
    try:
        fields = os.pread(file, _STAT_LINE, 0).decode(errors="replace").rpartition(")")[2].split()
    except ProcessLookupError:
        return "", 0.0
    finally:
        os.close(file)
    return fields[_STATE], (int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK
