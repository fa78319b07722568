"""Arrays of OPC UA that are longer than any request may be, or than their message: refused before they are read."""

from __future__ import annotations

from typing import Any

from asyncua import ua
from asyncua.common.utils import Buffer, NotEnoughData, ServiceError
from asyncua.ua import ua_binary

from cellwatt.outlets.opc_ua.bounds import OPERATIONS

MOST = max(OPERATIONS.values())

_unpack = ua_binary.unpack_uatype_array


def _bounded(kind: Any, data: Any) -> Any:
    if isinstance(data, Buffer):  # as all that comes through a socket
        length = ua_binary.Primitives.Int32.unpack(data.copy())
        if length > len(data):
            raise NotEnoughData(f"an array of {length} items in {len(data)} bytes")
        if length > MOST:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)
    return _unpack(kind, data)


def bound_arrays() -> None:
    """Have the library refuse them, in the whole process: reading 50,000 nodes' names takes it seconds."""
    ua_binary.unpack_uatype_array = _bounded
