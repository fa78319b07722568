"""RTDE protocol version 2, bytes ⇄ messages: pure functions, no I/O, no clock.

A frame is ``u16 size`` (including these three bytes), ``u8 kind``, payload; everything is big endian. Source: the RTDE
guide of Universal Robots. ``scan`` refuses a frame of a size that its kind cannot have, so that the other functions
parse payloads of these sizes; all raise only ``ProtocolError``.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from cellwatt.errors import ProtocolError

PROTOCOL = 2
"""The supported protocol version; a new connection starts at version 1."""
NAMES_LIMIT = 2048
"""Longest list of field names that a controller accepts, bytes."""


class Kind(IntEnum):
    """Frame kinds; a reply has the kind of its request."""

    PROTOCOL_VERSION = ord("V")
    CONTROLLER_VERSION = ord("v")
    TEXT_MESSAGE = ord("M")
    DATA_PACKAGE = ord("U")
    SETUP_OUTPUTS = ord("O")
    START = ord("S")
    PAUSE = ord("P")


Limits = Mapping[int, tuple[int, int]]
"""Smallest and largest size of each kind of frame in one direction."""

_TEXT = (6, 3 + 1 + 255 + 1 + 255 + 1)
_TYPES = (4, 3 + 1 + 16384)
FROM_CONTROLLER: Limits = {
    Kind.PROTOCOL_VERSION: (4, 4),
    Kind.CONTROLLER_VERSION: (19, 19),
    Kind.TEXT_MESSAGE: _TEXT,
    Kind.DATA_PACKAGE: (4, 0xFFFF),
    Kind.SETUP_OUTPUTS: _TYPES,
    Kind.START: (4, 4),
    Kind.PAUSE: (4, 4),
}
FROM_CLIENT: Limits = {
    Kind.PROTOCOL_VERSION: (5, 5),
    Kind.CONTROLLER_VERSION: (3, 3),
    Kind.TEXT_MESSAGE: _TEXT,
    Kind.SETUP_OUTPUTS: (11, 11 + NAMES_LIMIT),
    Kind.START: (3, 3),
    Kind.PAUSE: (3, 3),
}

ELEMENTS: Mapping[str, tuple[str, int]] = {
    "BOOL": ("u1", 1),
    "UINT8": ("u1", 1),
    "UINT32": (">u4", 1),
    "UINT64": (">u8", 1),
    "INT32": (">i4", 1),
    "DOUBLE": (">f8", 1),
    "VECTOR3D": (">f8", 3),
    "VECTOR6D": (">f8", 6),
    "VECTOR6INT32": (">i4", 6),
    "VECTOR6UINT32": (">u4", 6),
}
"""RTDE type → numpy type of one element and number of elements; packages have no padding."""
NOT_FOUND = "NOT_FOUND"
"""Replaces the type of a field that the controller does not have."""

_HEADER = struct.Struct(">HB")
_RATE = struct.Struct(">d")
_VERSION = struct.Struct(">4I")


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame other than a run of data packages; ``payload`` without the header."""

    kind: Kind
    payload: bytes


@dataclass(frozen=True, slots=True)
class Package:
    """Format of a recipe's data packages: recipe id and total size in bytes."""

    id: int
    size: int

    @property
    def header(self) -> int:
        """The first four bytes of each package as a number."""
        return self.size << 16 | Kind.DATA_PACKAGE << 8 | self.id


@dataclass(frozen=True, slots=True)
class Run:
    """``count`` adjacent data packages; ``data`` is a view of them, valid until the buffer is reused."""

    data: memoryview
    count: int


@dataclass(frozen=True, slots=True)
class ControllerVersion:
    """PolyScope's version."""

    major: int
    minor: int
    bugfix: int
    build: int

    def __str__(self) -> str:
        return f"{self.major}.{self.minor}.{self.bugfix}.{self.build}"


@dataclass(frozen=True, slots=True)
class TextMessage:
    """A message of the controller; ``level`` 0 exception, 1 error, 2 warning, 3 info."""

    text: str
    source: str
    level: int


def scan(
    data: memoryview, limits: Limits, package: Package | None = None, most: int | None = None
) -> Iterator[tuple[Frame | Run, int]]:
    """Split the start of a byte stream into frames: each with the number of bytes used up to its end.

    Data packages of the agreed ``package`` come as the longest possible runs, of at most ``most`` packages. An
    unfinished frame at the end is not used. Raises ``ProtocolError``, after all frames before it, as soon as a header
    has an unknown kind, a size that its kind cannot have, or is of a data package of another recipe.
    """
    start, end = 0, len(data)
    while end - start >= _HEADER.size:
        size, kind = _HEADER.unpack_from(data, start)
        shortest, longest = limits.get(kind, (1, 0))
        if not shortest <= size <= longest:
            raise ProtocolError(f"invalid RTDE frame: kind {kind:#04x} with size {size}")
        if kind == Kind.DATA_PACKAGE and package is not None:
            if size != package.size:
                raise ProtocolError(f"data package of {size} bytes, the recipe has {package.size}")
            count = _neighbours(data[start:], package, most)
            if not count:
                return
            size *= count
            yield Run(data[start : start + size], count), start + size
        elif start + size > end:
            return
        else:
            yield Frame(Kind(kind), bytes(data[start + _HEADER.size : start + size])), start + size
        start += size


def _neighbours(data: memoryview, package: Package, most: int | None) -> int:
    """Count the complete packages of the recipe at the start of ``data``, one after the other."""
    if len(data) >= 4 and data[3] != package.id:
        raise ProtocolError(f"data package of recipe {data[3]}, the agreed one is {package.id}")
    count = len(data) // package.size
    if most is not None:
        count = min(count, most)
    if count > 1:
        headers = np.ndarray((count,), ">u4", data, strides=(package.size,))
        strange = headers != package.header
        if strange.any():
            count = int(strange.argmax())
    return count


def frame(kind: Kind, payload: bytes = b"") -> bytes:
    """One frame."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


ASK_PROTOCOL = frame(Kind.PROTOCOL_VERSION, struct.pack(">H", PROTOCOL))
ASK_CONTROLLER = frame(Kind.CONTROLLER_VERSION)
START = frame(Kind.START)
PAUSE = frame(Kind.PAUSE)


def ask_outputs(rate: float, names: Sequence[str]) -> bytes:
    """Request a recipe of output fields at ``rate`` Hz. Raises ``ValueError`` if the list is too long."""
    text = ",".join(names).encode("ascii")
    if len(text) > NAMES_LIMIT:
        raise ValueError(f"the names of the fields take {len(text)} bytes; a controller takes {NAMES_LIMIT}")
    return frame(Kind.SETUP_OUTPUTS, _RATE.pack(rate) + text)


def recipe_reply(kind: Kind, recipe: int, types: Sequence[str]) -> bytes:
    """Answer to a recipe of outputs or inputs: its id and the type of each field."""
    return frame(kind, bytes([recipe]) + ",".join(types).encode("ascii"))


def accept_reply(kind: Kind, accepted: bool) -> bytes:
    """Answer to protocol version, start and pause."""
    return frame(kind, bytes([accepted]))


def controller_reply(version: ControllerVersion) -> bytes:
    """Answer to the request for the controller's version."""
    packed = _VERSION.pack(version.major, version.minor, version.bugfix, version.build)
    return frame(Kind.CONTROLLER_VERSION, packed)


def text_message(message: TextMessage) -> bytes:
    """A message of the controller. Raises ``ValueError`` if text or source is longer than 255 bytes."""
    parts = [message.text.encode(), message.source.encode()]
    if max(map(len, parts)) > 255:
        raise ValueError("text and source of a message hold at most 255 bytes each")
    return frame(Kind.TEXT_MESSAGE, b"".join(bytes([len(p)]) + p for p in parts) + bytes([message.level]))


ACCEPTED = b"\x01"
"""Payload of an acceptance."""


def parse_accept(payload: bytes) -> bool:
    """True if the controller accepted."""
    if payload[0] > 1:
        raise ProtocolError(f"an acceptance is 0 or 1, not {payload[0]}")
    return payload[0] == 1


def parse_controller(payload: bytes) -> ControllerVersion:
    """The controller's version."""
    return ControllerVersion(*_VERSION.unpack(payload))


def parse_recipe(payload: bytes) -> tuple[int, tuple[str, ...]]:
    """Id and types from the answer to a recipe; a type may be ``NOT_FOUND``."""
    types = _listed(payload[1:])
    for name in types:
        if name not in ELEMENTS and name != NOT_FOUND:
            raise ProtocolError(f"unknown RTDE type: {name[:40]!r}")
    return payload[0], types


def parse_ask_outputs(payload: bytes) -> tuple[float, tuple[str, ...]]:
    """Rate in Hz and field names of a client's recipe request."""
    (rate,) = _RATE.unpack_from(payload)
    if not 0 < rate < float("inf"):
        raise ProtocolError(f"no rate: {rate}")
    return rate, _listed(payload[_RATE.size :])


def parse_text(payload: bytes) -> TextMessage:
    """A message of the controller; bytes that are not UTF-8 are replaced."""
    texts: list[str] = []
    rest = payload
    for _ in range(2):
        if not rest or len(rest) < 1 + rest[0]:
            raise ProtocolError("a text message is shorter than it states")
        texts.append(rest[1 : 1 + rest[0]].decode("utf-8", "replace"))
        rest = rest[1 + rest[0] :]
    if len(rest) != 1:
        raise ProtocolError(f"a text message ends with one byte of level, not {len(rest)}")
    return TextMessage(texts[0], texts[1], rest[0])


def _listed(text: bytes) -> tuple[str, ...]:
    """Comma-separated names; the list may end with a comma."""
    try:
        names = text.decode("ascii").split(",")
    except UnicodeDecodeError as error:
        raise ProtocolError(f"a list of names is not ASCII: {text[:40]!r}") from error
    if names[-1] == "":
        names.pop()
    return tuple(names)
