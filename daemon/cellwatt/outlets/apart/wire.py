"""The process that serves for an outlet, begun with a socket to it, and the messages through that: kind, length, body.

Frames travel as raw arrays with their layout sent once before; all else is JSON.
"""

from __future__ import annotations

import asyncio
import contextlib
import resource
import signal
import socket
import struct
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import asdict, fields
from enum import IntEnum
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from cellwatt.child import ends_with_parent
from cellwatt.errors import OutletError, ProtocolError
from cellwatt.frames import Frames, Layout
from cellwatt.outlets.zenoh.messages import encode_json, parse_json, topic_of
from cellwatt.results import Event, Result

LARGEST: Final = 64 * 2**20
"""Bytes of one message."""
HEAD: Final = struct.Struct(">BI")
_FRAMES: Final = struct.Struct("<qi")
_LAYOUT: Final = TypeAdapter(Layout)


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


def message(kind: Kind, body: bytes) -> bytes:
    """Bytes of a message."""
    return HEAD.pack(kind, len(body)) + body


def json_message(kind: Kind, body: Any) -> bytes:
    """Bytes of a message whose body is JSON."""
    return message(kind, encode_json(body))


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


def item(result: Result | Event) -> bytes:
    """Bytes of a result or event."""
    body = {field.name: getattr(result, field.name) for field in fields(result)}
    return json_message(Kind.ITEM, {"kind": topic_of(result).partition("/")[0], "body": body})


def layout(columns: Layout) -> bytes:
    """Bytes of the columns of the frames that follow."""
    return json_message(Kind.LAYOUT, asdict(columns))


def read_layout(body: bytes) -> Layout:
    """Columns of the frames that follow. Raises ``ProtocolError``."""
    try:
        return _LAYOUT.validate_python(parse_json(body))
    except (ValidationError, ValueError) as error:
        raise ProtocolError(f"the columns of frames cannot be read: {error}") from error


def frames(block: Frames) -> bytes:
    """Bytes of frames: sequence, count, then times, values and quality; bounds stay behind."""
    head = _FRAMES.pack(block.sequence, len(block))
    arrays = (
        np.ascontiguousarray(block.time, np.int64),
        np.ascontiguousarray(block.values, np.float64),
        np.ascontiguousarray(block.quality, np.uint8),
    )
    return message(Kind.FRAMES, b"".join((head, *(array.tobytes() for array in arrays))))


def read_frames(body: bytes, columns: Layout) -> Frames:
    """Frames with bounds of 0. Raises ``ProtocolError``."""
    width = len(columns.channels)
    try:
        sequence, n = _FRAMES.unpack_from(body)
        cells, start = n * width, _FRAMES.size
        if n < 0 or len(body) != start + 8 * n + 9 * cells:
            raise ValueError(f"{len(body)} bytes are not {n} frames of {width} channels")
        time = np.frombuffer(body, np.int64, n, start)
        values = np.frombuffer(body, np.float64, cells, start + 8 * n).reshape(n, width)
        quality = np.frombuffer(body, np.uint8, cells, start + 8 * (n + cells)).reshape(n, width)
    except (struct.error, ValueError) as error:
        raise ProtocolError(f"frames cannot be read: {error}") from error
    return Frames(columns, sequence, time, values, quality, np.zeros((n, width), np.int64))


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
