"""Two pseudo-terminals, joined: what is written to one is read from the other."""

from __future__ import annotations

import asyncio
import os
import pty
import tty
from collections.abc import Iterator
from contextlib import contextmanager

CHUNK = 4096


@contextmanager
def virtual_line() -> Iterator[tuple[str, str]]:
    """Paths of both ends of a serial line; must be entered on a running loop."""
    loop = asyncio.get_running_loop()
    ends = [pty.openpty() for _ in range(2)]
    masters = [master for master, _ in ends]
    for master, slave in ends:
        tty.setraw(slave)
        os.set_blocking(master, False)
    try:
        for source, sink in (masters, masters[::-1]):
            loop.add_reader(source, _pass_on, source, sink)
        yield os.ttyname(ends[0][1]), os.ttyname(ends[1][1])
    finally:
        for master, slave in ends:
            loop.remove_reader(master)
            os.close(master)
            os.close(slave)


def _pass_on(source: int, sink: int) -> None:
    try:
        os.write(sink, os.read(source, CHUNK))
    except BlockingIOError:
        return  # nobody reads the far end: its bytes are lost, as on a line
