"""Arrays of OPC UA that are longer than any request may be, or than their message: refused before they are read."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

from asyncua import ua
from asyncua.common.utils import Buffer, NotEnoughData, ServiceError
from asyncua.ua import ua_binary

ENTRIES: Final = 1000
"""Entries of a request, and of any array in it."""
READERS: Final = ("_create_list_deserializer", "_create_uatype_array_deserializer")
"""What makes the library's readers of arrays of structures, and of plain values."""

Reader = Callable[[Any], Any]


def _bounded(make: Callable[[Any], Reader]) -> Callable[[Any], Reader]:
    @cache
    def bounded(kind: Any) -> Reader:
        read = make(kind)

        def checked(data: Any) -> Any:
            if isinstance(data, Buffer):  # as all that comes through a socket
                length = ua_binary.Primitives.Int32.unpack(data.copy())
                if length > len(data):
                    raise NotEnoughData(f"an array of {length} items in {len(data)} bytes")
                if length > ENTRIES:
                    raise ServiceError(ua.StatusCodes.BadTooManyOperations)
            return read(data)

        return checked

    return bounded


def bound_arrays() -> None:
    """Have the library refuse them, in the whole process: reading 50,000 nodes' names takes it seconds."""
    for name in READERS:
        setattr(ua_binary, name, _bounded(getattr(ua_binary, name)))
