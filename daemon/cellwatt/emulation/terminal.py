"""Pseudo-terminals, the serial lines of emulated devices, and a port on a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
import pty
import tty
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AsyncExitStack, contextmanager, suppress
from pathlib import Path
from typing import Protocol

from cellwatt.emulation.emulator import Emulator
from cellwatt.emulation.port import Port, TcpPort


@contextmanager
def raw_terminal(link: Path | None = None) -> Iterator[tuple[int, str]]:
    """Open a raw pseudo-terminal; yields the non-blocking descriptor of the device's end, and the client's path.

    Both ends are closed at exit. ``link`` is a symbolic link to create to the client's end; its path is then yielded.
    Raises ``OSError`` if the link's path is in use.
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
    """Create a symbolic link to a pseudo-terminal; replaces a link that an emulator has left behind.

    Raises ``FileExistsError`` if the path is a device, a file or a link to any other target.
    """
    if link.is_symlink() and (not link.exists() or link.readlink().is_relative_to("/dev/pts")):
        link.unlink()
    link.symlink_to(terminal)


class Writer(Protocol):
    """Receives the emulator's answers."""

    def write(self, data: bytes, /) -> object:
        """Send data."""
        ...


class _Near:
    """The emulator's end of a line."""

    def __init__(self, file: int) -> None:
        self._file = file

    def write(self, data: bytes, /) -> int:
        return os.write(self._file, data)


class PtyPort(Port):
    """A line with one client that is always connected; all bytes are lost during an interruption."""

    def __init__(self, emulator: Emulator, talk: Callable[[asyncio.StreamReader, Writer], Awaitable[None]]) -> None:
        super().__init__(emulator)
        self._talk = talk
        self._link = emulator.link
        self._outages: asyncio.Queue[float] = asyncio.Queue()
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> str:
        """See ``Port``."""
        near, far = await asyncio.to_thread(self._stack.enter_context, raw_terminal(self._link))
        reader = asyncio.StreamReader()
        transport, _ = await asyncio.get_running_loop().connect_read_pipe(
            lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(os.dup(near), "rb", 0)
        )
        self._stack.callback(transport.close)
        serving = asyncio.create_task(self._serve(reader, _Near(near)))
        self._stack.push_async_callback(_ended, serving)
        return far

    async def __aexit__(self, *_: object) -> None:
        """See ``Port``."""
        await self._stack.aclose()

    def interrupt(self, seconds: float) -> None:
        """See ``Port.interrupt``."""
        self._outages.put_nowait(seconds)

    async def _serve(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        while True:
            talking = asyncio.ensure_future(self._converse(reader, writer))
            try:
                seconds = await self._outages.get()
            finally:
                await _ended(talking)
            await _lose_bytes(reader, seconds)

    async def _converse(self, reader: asyncio.StreamReader, writer: Writer) -> None:
        """Talk; restart after a client that does not read or sends an invalid message, because the line stays open."""
        while not reader.at_eof():
            with suppress(OSError, ValueError):
                await self._talk(reader, writer)


def port_of(emulator: Emulator, talk: Callable[[asyncio.StreamReader, Writer], Awaitable[None]]) -> Port:
    """A serial line or a TCP port, depending on the emulator's address."""
    return PtyPort(emulator, talk) if emulator.on_terminal else TcpPort(emulator, talk)


async def _ended(task: asyncio.Future[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def _lose_bytes(reader: asyncio.StreamReader, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            while True:
                await reader.read(4096)
    except TimeoutError:
        pass  # the cable is connected again
