"""Refuses OPC UA arrays longer than ``ENTRIES``, or longer than their message, before they are decoded."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Final

from asyncua import ua
from asyncua.common.utils import Buffer, NotEnoughData, ServiceError
from asyncua.ua import ua_binary

ENTRIES: Final = 1000
"""Most entries of a request, and of any array in it."""
READERS: Final = ("_create_list_deserializer", "_create_uatype_array_deserializer")
"""Library functions that make decoders of arrays of structures, and of plain values."""

Reader = Callable[[Any], Any]


def _bounded(make: Callable[[Any], Reader]) -> Callable[[Any], Reader]:
    @cache
    def bounded(kind: Any) -> Reader:
        read = make(kind)

        def checked(data: Any) -> Any:
            if isinstance(data, Buffer):  # everything received through a socket
                length = ua_binary.Primitives.Int32.unpack(data.copy())
                if length > len(data):
                    raise NotEnoughData(f"an array of {length} items in {len(data)} bytes")
                if length > ENTRIES:
                    raise ServiceError(ua.StatusCodes.BadTooManyOperations)
            return read(data)

        return checked

    return bounded


def bound_arrays() -> None:
    """Make the library refuse longer arrays, in the whole process: decoding 50,000 node names takes seconds."""
    for name in READERS:
        setattr(ua_binary, name, _bounded(getattr(ua_binary, name)))
