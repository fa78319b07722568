"""Pseudo-terminals, the serial lines of emulated devices."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def raw_terminal() -> Iterator[tuple[int, str]]:
    """Open a pseudo-terminal in raw mode: the descriptor of the device's end, non-blocking, and the path of the other.

    Both are closed at the end.
    """
    near, far = pty.openpty()
    try:
        tty.setraw(far)
        os.set_blocking(near, False)
        yield near, os.ttyname(far)
    finally:
        os.close(near)
        os.close(far)
