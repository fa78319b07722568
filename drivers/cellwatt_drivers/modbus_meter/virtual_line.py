"""Two pseudo-terminals, joined: what is written to one is read from the other."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cellwatt.emulation.terminal import raw_terminal

CHUNK = 4096


@contextmanager
def virtual_line(link: Path | None = None) -> Iterator[tuple[str, str]]:
    """Paths of both ends of a serial line, the other one's as ``link``; must be entered on a running loop."""
    loop = asyncio.get_running_loop()
    with raw_terminal() as (one, path_one), raw_terminal(link) as (other, path_other):
        loop.add_reader(one, _pass_on, one, other)
        loop.add_reader(other, _pass_on, other, one)
        try:
            yield path_one, path_other
        finally:
            loop.remove_reader(one)
            loop.remove_reader(other)


def _pass_on(source: int, sink: int) -> None:
    try:
        os.write(sink, os.read(source, CHUNK))
    except BlockingIOError:
        return  # nobody reads the far end: its bytes are lost, as on a line
