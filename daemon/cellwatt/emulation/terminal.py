"""Pseudo-terminals, the serial lines of emulated devices."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def raw_terminal(link: Path | None = None) -> Iterator[tuple[int, str]]:
    """Open a pseudo-terminal in raw mode: the descriptor of the device's end, non-blocking, and the path of the other.

    Both are closed at the end. ``link`` is a symbolic link to put to the other end, whose path it is then. Raises
    ``OSError`` where its place is taken.
    """
    near, far = pty.openpty()
    try:
        tty.setraw(far)
        os.set_blocking(near, False)
        terminal = os.ttyname(far)
        if link is not None:
            put_link(link, terminal)
        try:
            yield near, str(link or terminal)
        finally:
            if link is not None:
                link.unlink(missing_ok=True)
    finally:
        os.close(near)
        os.close(far)


def put_link(link: Path, terminal: str) -> None:
    """Let a symbolic link lead to a pseudo-terminal, in place of one that an emulator left behind.

    Raises ``FileExistsError`` where a device, a file or a link to another place is there.
    """
    if link.is_symlink() and (not link.exists() or link.readlink().is_relative_to("/dev/pts")):
        link.unlink()
    link.symlink_to(terminal)
