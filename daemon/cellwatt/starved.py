"""Tells a process that other programs keep from running from one that hangs."""

from __future__ import annotations

import os
from typing import Final

SHARE: Final = 0.5
"""Of a processor: a process that wants to run and gets less since it was last heard of is kept from running."""
_LINE: Final = 1024
"""Bytes of /proc/PID/stat at most."""
_TICK: Final = 1 / os.sysconf("SC_CLK_TCK")  # s
_STATE, _USER, _SYSTEM = 0, 11, 12
"""Fields of /proc/PID/stat after the name."""


def spent(process: int) -> float:
    """Processor time, s, that the process of this number has taken so far; 0 if it is gone."""
    return _seen(process)[1]


def starved(process: int, before: float, silent: float) -> bool:
    """True if a process waits for a processor or the disk, and has hardly computed in the last ``silent`` s.

    ``process`` is its number, ``before`` the processor time, s, that it had taken by then.
    """
    state, taken = _seen(process)
    return state in ("R", "D") and taken - before < SHARE * silent


def _seen(process: int) -> tuple[str, float]:
    try:
        file = os.open(f"/proc/{process}/stat", os.O_RDONLY | os.O_CLOEXEC)  # in memory: nobody waits for a disk
    except OSError:
        return "", 0.0
    try:
        fields = os.pread(file, _LINE, 0).decode(errors="replace").rpartition(")")[2].split()
    except ProcessLookupError:
        return "", 0.0
    finally:
        os.close(file)
    return fields[_STATE], (int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK
