"""Serial ports, and why one cannot be opened."""

from __future__ import annotations

import errno
import termios
from pathlib import Path

import serial

from cellwatt.errors import ConnectError

BY_ID = Path("/dev/serial/by-id")


def open_port(path: str, baud: int) -> serial.Serial:
    """Open a port exclusively, without waiting in reads and writes. Raises ``ConnectError`` with the reason."""
    try:
        return serial.Serial(path, baud, timeout=0, write_timeout=0, exclusive=True)
    except (OSError, ValueError, termios.error) as error:
        raise ConnectError(f"{path}: {_why(error, baud)}") from error


def _why(error: Exception, baud: int) -> str:
    # pyserial sets errno only for a failed open; after a failed lock or set-up the text contains it.
    number = getattr(error, "errno", None)
    text = str(error)
    if number == errno.ENOENT:
        return f"no such port ({_present()})"
    if number == errno.EACCES:
        return "permission denied: the user that runs cellwatt must be in the port's group (dialout)"
    if number == errno.EBUSY or "exclusively lock" in text:
        return "in use by another program"
    if number == errno.ENOTTY or "Inappropriate ioctl" in text:
        return "is not a serial port"
    if isinstance(error, ValueError):
        return f"does not know {baud} baud"
    return f"cannot be opened: {text}"


def _present() -> str:
    names = sorted(p.name for p in BY_ID.glob("*"))
    return f"in {BY_ID}: {', '.join(names)}" if names else "no USB serial adapter is plugged in"
