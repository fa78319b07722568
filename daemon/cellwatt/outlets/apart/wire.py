"""Starts the serving process of an outlet with a socket to it; messages through the socket: kind, length, body.

The daemon's messages are pickled objects. The daemon accepts only JSON from the process, because strangers reach the
process.
"""

from __future__ import annotations

import asyncio
import contextlib
import pickle
import resource
import signal
import socket
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from enum import IntEnum
from typing import Any, Final

from cellwatt.child import MODULE, ends_with_parent
from cellwatt.errors import OutletError, ProtocolError
from cellwatt.outlets.zenoh.messages import encode_json

LARGEST: Final = 64 * 2**20
"""Most bytes of one message."""
HEAD: Final = struct.Struct(">BI")


class Kind(IntEnum):
    """Kind of a message; those from ``READY`` on are sent by the serving process."""

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


def from_process(kind: Kind, body: Any) -> bytes:
    """Bytes of a message of the serving process."""
    return _message(kind, encode_json(body))


def from_daemon(kind: Kind, body: Any) -> bytes:
    """Bytes of a message of the daemon."""
    return _message(kind, pickle.dumps(body))


async def receive(reader: asyncio.StreamReader) -> tuple[Kind, bytes] | None:
    """The next message; ``None`` once the other end has closed. Raises ``ProtocolError``."""
    try:
        number, length = HEAD.unpack(await reader.readexactly(HEAD.size))
        if length > LARGEST:
            raise ProtocolError(f"a message of {length} bytes; {LARGEST} are the most")
        return Kind(number), await reader.readexactly(length)
    except (asyncio.IncompleteReadError, ConnectionError):
        return None
    except ValueError as error:
        raise ProtocolError(f"a message of an unknown kind: {error}") from error


END: Final = 3.0
"""Longest time, s, for the process to end after its socket is closed, and again after SIGTERM."""
LIMIT: Final = 2**20
"""Most unread bytes at either end of the socket."""


@asynccontextmanager
async def running(
    module: str, what: str, memory: int
) -> AsyncIterator[tuple[asyncio.subprocess.Process, asyncio.StreamReader, asyncio.StreamWriter]]:
    """Run ``python -m module FD`` with at most ``memory`` bytes; yield the process and the streams of its socket.

    On exit, close its socket, then send SIGTERM, then kill it. Raises ``OutletError``, which names ``what``, if it
    cannot be started.
    """
    ours, theirs = socket.socketpair()
    with theirs:
        reader, writer = await asyncio.open_connection(sock=ours, limit=LIMIT)
        number, nothing = theirs.fileno(), asyncio.subprocess.DEVNULL
        command = (*MODULE, module, str(number))
        try:
            process = await asyncio.create_subprocess_exec(
                *command, stdin=nothing, stdout=nothing, pass_fds=(number,), preexec_fn=_bounded(memory)
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
    """How the process ended, as text."""
    code = process.returncode
    if code is not None and code < 0:
        return f"by {signal.Signals(-code).name}"
    return f"exit code {code}"
