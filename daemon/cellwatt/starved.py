"""Tells a process that other programs keep from running from one that hangs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

SHARE: Final = 0.5
"""Of a processor: a process that wants to run and gets less since it was last heard of is kept from running."""
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
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return "", 0.0
    return fields[_STATE], (int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK
