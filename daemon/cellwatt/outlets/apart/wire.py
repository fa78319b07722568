"""Messages between the daemon and a process that serves for an outlet: kind, length, body. Pure but for ``receive``.

Frames travel as raw arrays with their layout sent once before; all else is JSON.
"""

from __future__ import annotations

import asyncio
import struct
from dataclasses import asdict, fields
from enum import IntEnum
from typing import Any, Final

import numpy as np
from pydantic import TypeAdapter, ValidationError

from cellwatt.errors import ProtocolError
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
