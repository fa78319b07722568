"""Messages to systemd from a ``Type=notify`` service, as sd_notify(3) describes them, without its library.

The functions do nothing if systemd did not start the process (no ``NOTIFY_SOCKET``).
"""

from __future__ import annotations

import functools
import logging
import os
import socket
import time

log = logging.getLogger(__name__)


def notify(**fields: str) -> bool:
    """Send systemd ``FIELD=value`` for each field, in one message; return whether it was sent.

    E.g. ``notify(READY="1", STATUS="4 of 4 sources up")``. Never blocks, and never raises if systemd
    does not listen. Raises ``ValueError`` for a value with a line break, which would start another field.
    """
    if any("\n" in value for value in fields.values()):
        raise ValueError("a value sent to systemd must be one line")
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    if address.startswith("@"):  # Linux' abstract namespace
        address = "\0" + address[1:]
    message = "\n".join(f"{name}={value}" for name, value in fields.items()).encode(errors="replace")
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK) as to:
            to.sendto(message, address)
    except OSError as error:
        _warn_once(f"systemd does not listen at its notify socket: {error}")
        return False
    return True


@functools.cache
def _warn_once(text: str) -> None:
    """Log a warning once, although the daemon notifies once a second."""
    log.warning("%s", text)


def reloading() -> bool:
    """Notify systemd that a reload begins; ``notify(READY="1")`` ends it."""
    return notify(RELOADING="1", MONOTONIC_USEC=str(time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000))
