"""Arrays of OPC UA that claim more items than their message has bytes, as only an attacker sends them."""

from __future__ import annotations

from typing import Any

from asyncua.common.utils import Buffer, NotEnoughData
from asyncua.ua import ua_binary

_unpack = ua_binary.unpack_uatype_array


def _bounded(kind: Any, data: Any) -> Any:
    if isinstance(data, Buffer):  # as all that comes through a socket
        length = ua_binary.Primitives.Int32.unpack(data.copy())
        if length > len(data):
            raise NotEnoughData(f"an array of {length} items in {len(data)} bytes")
    return _unpack(kind, data)


def bound_arrays() -> None:
    """Have the library refuse them, in the whole process: it makes 2**31 empty items out of 8 bytes otherwise."""
    ua_binary.unpack_uatype_array = _bounded
