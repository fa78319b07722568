"""The process that serves for an outlet, begun with a socket to it, and the messages through that: kind, length, body.

The process takes the daemon's objects as they are (pickle). The daemon takes nothing but JSON from the process, which
strangers reach.
"""

from __future__ import annotations

import asyncio
import contextlib
import pickle
import resource
import signal
import socket
import struct
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from enum import IntEnum
from typing import Any, Final

from cellwatt.child import ends_with_parent
from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.zenoh.messages import encode_json

LARGEST: Final = 64 * 2**20
"""Bytes of one message."""
HEAD: Final = struct.Struct(">BI")


class Kind(IntEnum):
    """What a message is; those from ``READY`` on come from the process that serves."""

    HELLO = 1
    LAYOUT = 2
    FRAMES = 3
    ITEM = 4
    HEALTH = 5
    ANSWER = 6
    READY = 10
    FAILED = 11
    ALIVE = 12
    ORDER = 13


def _message(kind: Kind, body: bytes) -> bytes:
    return HEAD.pack(kind, len(body)) + body


def said(kind: Kind, body: Any) -> bytes:
    """Bytes of a message of the process that serves."""
    return _message(kind, encode_json(body))


def told(kind: Kind, body: Any) -> bytes:
    """Bytes of a message of the daemon."""
    return _message(kind, pickle.dumps(body))


async def receive(reader: asyncio.StreamReader) -> tuple[Kind, bytes] | None:
    """The next message; ``None`` once the other side has closed. Raises ``ProtocolError``."""
    try:
        number, length = HEAD.unpack(await reader.readexactly(HEAD.size))
        if length > LARGEST:
            raise ProtocolError(f"a message of {length} bytes; {LARGEST} are the most")
        return Kind(number), await reader.readexactly(length)
    except (asyncio.IncompleteReadError, ConnectionError):
        return None
    except ValueError as error:
        raise ProtocolError(f"a message of no known kind: {error}") from error


END: Final = 3.0
"""Longest time, s, for its end after its socket is closed, and again after it is told to end."""
LIMIT: Final = 2**20
"""Bytes that wait at either end of the socket before they are read."""


@asynccontextmanager
async def running(
    module: str, what: str, memory: int
) -> AsyncIterator[tuple[asyncio.subprocess.Process, asyncio.StreamReader, asyncio.StreamWriter]]:
    """Run ``python -m module FD`` with so many bytes of memory at most; give it, and what it is told through.

    Afterwards its socket is closed, then it is told to end, then it is killed. Raises ``OutletError`` if it cannot be
    started; ``what`` names it there.
    """
    ours, theirs = socket.socketpair()
    with theirs:
        reader, writer = await asyncio.open_connection(sock=ours, limit=LIMIT)
        try:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                module,
                str(theirs.fileno()),
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                preexec_fn=_bounded(memory),
            )
        except BaseException as error:
            writer.close()
            if isinstance(error, OSError):
                raise OutletError(f"{what} cannot be started: {error.strerror}") from error
            raise
    try:
        yield process, reader, writer
    finally:
        ended = asyncio.ensure_future(process.wait())
        for end, patience in ((writer.close, END), (process.terminate, END), (process.kill, None)):
            if not ended.done():
                with contextlib.suppress(ProcessLookupError):
                    end()
                await asyncio.wait([ended], timeout=patience)


def _bounded(memory: int) -> Callable[[], None]:
    tie = ends_with_parent(signal.SIGTERM)

    def begin() -> None:
        tie()
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))

    return begin


def end_of(process: asyncio.subprocess.Process) -> str:
    """How the process ended, in words."""
    code = process.returncode
    if code is not None and code < 0:
        return f"by {signal.Signals(-code).name}"
    return f"exit code {code}"
