"""Serial ports, and why one cannot be opened."""

from __future__ import annotations

import contextlib
import errno
import os
import termios
from glob import iglob
from pathlib import Path

import serial

from cellwatt.errors import ConnectError

BY_ID = Path("/dev/serial/by-id")


def open_port(path: str, baud: int) -> serial.Serial:
    """Open a port exclusively, without waiting in reads and writes. Raises ``ConnectError`` with the reason."""
    try:
        return serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError, termios.error) as error:
        raise ConnectError(f"{path}: {_why(error, path, baud)}") from error


def _why(error: Exception, path: str, baud: int) -> str:
    # pyserial sets errno only for a failed open; after a failed lock or set-up the text contains it.
    number = getattr(error, "errno", None)
    text = str(error)
    if number == errno.ENOENT:
        return f"no such port ({_present()})"
    if number == errno.EACCES:
        return "permission denied: the user that runs cellwatt must be in the port's group (dialout)"
    if number == errno.EBUSY or "exclusively lock" in text:
        return f"in use by {_holder(path)}"
    if number == errno.ENOTTY or "Inappropriate ioctl" in text:
        return "is not a serial port"
    if isinstance(error, ValueError):
        return f"does not know {baud} baud"
    return f"cannot be opened: {text}"


def _holder(path: str) -> str:
    """The program that has the port open, if the kernel shows it to this user."""
    device = os.path.realpath(path)
    for descriptor in iglob("/proc/[0-9]*/fd/*"):  # noqa: PTH207 - Path.glob fails where a process ends meanwhile
        with contextlib.suppress(OSError):  # of another user, or ended meanwhile
            if os.readlink(descriptor) == device:  # noqa: PTH115
                process = Path(descriptor).parents[1]
                return f"{(process / 'comm').read_text().strip()} (process {process.name})"
    return "another program"


def _present() -> str:
    names = sorted(p.name for p in BY_ID.glob("*"))
    return f"in {BY_ID}: {', '.join(names)}" if names else "no USB serial adapter is plugged in"
