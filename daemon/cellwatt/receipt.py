"""Kernel time stamps of received data, which stay right if the process reads the data late."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterable
from typing import Any, Final

_SO_TIMESTAMPNS: Final = 35
"""Linux, <asm-generic/socket.h>; Python has no name for it."""
_TIMESPEC: Final = struct.Struct("=qq")
_ANCILLARY: Final = socket.CMSG_SPACE(_TIMESPEC.size)
_STEP: Final = 1_000_000
"""Change of the wall clock against CLOCK_MONOTONIC between two receipts, ns, above which the wall clock was set."""


class _WallClock:
    """The wall clock, which stamps the data, and when it was set: stamps from before then tell no waiting time."""

    def __init__(self) -> None:
        wall, now = _clocks()
        self._lead = wall - now
        self._set_at = 0
        """Time of CLOCK_MONOTONIC, ns, before which it was set last."""

    def since(self, stamp: int) -> int:
        """Time since a stamp, ns; 0 if it is unknown."""
        wall, now = _clocks()
        before, self._lead = self._lead, wall - now
        if abs(self._lead - before) > _STEP:
            self._set_at = now
        waited = wall - stamp
        return waited if 0 < waited <= now - self._set_at else 0


def _clocks() -> tuple[int, int]:
    """Read the wall clock and CLOCK_MONOTONIC, ns, again if this process was interrupted in between."""
    while True:
        begun, wall, now = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if now - begun < _STEP:
            return wall, now


_clock: Final = _WallClock()


def stamp_receipts(opened: socket.socket) -> bool:
    """Switch on kernel time stamps for a socket; return False if the kernel refuses."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    except OSError:
        return False
    return True


def receive(opened: socket.socket, size: int) -> tuple[bytes, Any, int]:
    """Receive a datagram of at most ``size`` bytes; return it, its sender, and its waiting time in this PC, ns.

    The waiting time is 0 without a kernel time stamp, and if the wall clock was set since. Raises ``OSError`` as
    ``socket.recvmsg`` does.
    """
    datagram, ancillary, _, sender = opened.recvmsg(size, _ANCILLARY)
    return datagram, sender, _waited(ancillary)


def receive_into(opened: socket.socket, room: memoryview) -> tuple[int, int]:
    """Receive the next bytes of a connection; return how many, and the waiting time of the newest in this PC, ns.

    The waiting time is 0 without a kernel time stamp, and if the wall clock was set since. Raises ``OSError`` as
    ``socket.recvmsg_into`` does.
    """
    size, ancillary, _, _ = opened.recvmsg_into([room], _ANCILLARY)
    return size, _waited(ancillary)


def _waited(ancillary: Iterable[tuple[int, int, bytes]]) -> int:
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return _clock.since(seconds * 1_000_000_000 + nanoseconds)
    return 0
