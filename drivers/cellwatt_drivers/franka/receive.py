"""pylibfranka in its own process: ``python receive.py HOST EVERY ATTRIBUTE …`` (see ``library``).

Its reads block and hold the GIL, so it cannot run in the daemon. Writes each state whose time in ms is a multiple of
EVERY to standard output as float64: that time, the delay of this process by the host since the last state, ms, then
the attributes' values. Ends with a line on standard error when the library fails.
"""

from __future__ import annotations

import contextlib
import fcntl
import gc
import os
import struct
import sys
import time
from collections.abc import Sequence
from typing import Any

from cellwatt.processor import RunDelay

_SHORTEST = 0.004
"""Shortest time between two writes, s: the daemon wakes for several states, not for each."""
_PRIORITY = 11
"""Above the daemon's priority, which may compute for longer than a state lasts."""
_PIPE = 1 << 20
"""Bytes that the pipe to the daemon holds, some 2 s of states: a full pipe would block the library's reads."""


def main(host: str, every: int, attributes: Sequence[str]) -> None:
    """Forward the robot's states until the connection ends."""
    import pylibfranka

    pipe = os.dup(1)  # the library's own output goes to standard error
    os.dup2(2, 1)
    with contextlib.suppress(OSError):  # above the system's limit: the pipe's size is unchanged
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE)
    gc.disable()  # states create no reference cycles, and a collection may last longer than a state
    robot = pylibfranka.Robot(host, pylibfranka.RealtimeConfig.kIgnore)
    # The library holds only the newest state: a reader that is a millisecond late loses one.
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    waiting = b""
    written = 0.0
    kept, held, last = RunDelay(), 0, 0
    while True:
        state = robot.read_once()
        stamp = round(state.time.to_sec() * 1e3)
        missed, last = 0 < last < stamp - 1, stamp
        if missed:
            held += kept.look()
        if stamp % every:
            continue
        waiting += _pack(stamp, held / 1e6, state, attributes)
        held = 0
        now = time.monotonic()
        if now - written >= _SHORTEST:
            written = now
            if not missed:
                kept.look()
            while waiting:
                waiting = waiting[os.write(pipe, waiting) :]


def _pack(stamp: int, held: float, state: Any, attributes: Sequence[str]) -> bytes:
    row = [float(stamp), held]
    for name in attributes:
        value = getattr(state, name)
        if isinstance(value, list):
            row += value
        elif name == "robot_mode":
            row.append(int(value))
        else:
            row.append(float(bool(value)) if name == "current_errors" else value)
    return struct.pack(f"<{len(row)}d", *row)


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]), sys.argv[3:])
    except BrokenPipeError:
        sys.exit(0)
    except Exception as error:  # the library's exceptions have no other common class
        sys.exit(f"{type(error).__name__}: {' '.join(str(error).split())}")
