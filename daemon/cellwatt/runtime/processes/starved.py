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


def starved(process: int, spent: float, silent: float) -> bool:
    """True if a process waits for a processor or the disk, and has hardly computed in the last ``silent`` s.

    ``process`` is its number, ``spent`` the processor time, s, that it had taken by then.
    """
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:  # it is gone
        return False
    taken = (int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK
    return fields[_STATE] in ("R", "D") and taken - spent < SHARE * silent
