"""A serial line to an emulated analyzer: a pseudo-terminal."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from typing import Protocol

from cellwatt.emulation import Emulator, Port
from cellwatt.emulation.terminal import raw_terminal


class Writer(Protocol):
    """Takes answers."""

    def write(self, data: bytes, /) -> object:
        """Send them."""
        ...


class _Near:
    """The emulator's end of a line."""

    def __init__(self, file: int) -> None:
        self._file = file

    def write(self, data: bytes, /) -> None:
        os.write(self._file, data)


class PtyPort(Port):
    """One client on a line that is always there; while it is interrupted, all bytes are lost."""

    def __init__(self, emulator: Emulator, talk: Callable[[asyncio.StreamReader, Writer], Awaitable[None]]) -> None:
        super().__init__(emulator)
        self._talk = talk
        self._link = emulator.link
        self._outages: asyncio.Queue[float] = asyncio.Queue()
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> str:
        """See ``Port``."""
        near, far = self._stack.enter_context(raw_terminal(self._link))
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
            talking = asyncio.ensure_future(self._talk(reader, writer))
            try:
                seconds = await self._outages.get()
            finally:
                await _ended(talking)
            await _lose_bytes(reader, seconds)


async def _ended(task: asyncio.Future[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def _lose_bytes(reader: asyncio.StreamReader, seconds: float) -> None:
    try:
        async with asyncio.timeout(seconds):
            while True:
                await reader.read(4096)
    except TimeoutError:
        pass  # the cable is back
