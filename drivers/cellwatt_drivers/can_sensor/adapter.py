"""An slcan adapter (LAWICEL's ASCII protocol) on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cellwatt.emulation.terminal import raw_terminal

CHUNK = 4096


class Adapter:
    """The adapter's side: obeys O, L, C and S, and sends frames while it is open.

    ``heard`` are the commands that came; ``port`` is where a client finds it.
    """

    def __init__(self, master: int, port: str) -> None:
        self.port = port
        self.heard: list[str] = []
        self.is_open = False
        self._master = master
        self._partial = b""

    def read(self) -> None:
        """Called by the loop when the client wrote."""
        try:
            data = os.read(self._master, CHUNK)
        except BlockingIOError:
            return
        *commands, self._partial = (self._partial + data).split(b"\r")
        for command in commands:
            text = command.decode("ascii", "replace")
            self.heard.append(text)
            if text[:1] in {"O", "L"}:
                self.is_open = True
            elif text[:1] == "C":
                self.is_open = False
            self.write(b"\r")

    def send(self, identifier: int, data: bytes) -> bool:
        """Send a standard frame to the client; true if it was taken."""
        return self.is_open and self.write(f"t{identifier:03X}{len(data)}{data.hex().upper()}\r".encode())

    def write(self, data: bytes) -> bool:
        """Send bytes to the client; false if it does not read."""
        try:
            return os.write(self._master, data) == len(data)
        except BlockingIOError:
            return False


@contextmanager
def virtual_adapter(link: Path | None = None) -> Iterator[Adapter]:
    """An adapter at a port of its own, or at ``link``; must be entered on a running loop."""
    loop = asyncio.get_running_loop()
    with raw_terminal(link) as (near, far):
        adapter = Adapter(near, far)
        loop.add_reader(near, adapter.read)
        try:
            yield adapter
        finally:
            loop.remove_reader(near)
