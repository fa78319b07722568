"""Items, results and errors as bytes between a command and its workers.

Path of a file that was fetched from a URL travels as that URL, so that each host has its own copy.
"""

from __future__ import annotations

import io
import pickle
import traceback
from pathlib import Path
from typing import Any

import cloudpickle  # type: ignore[import-untyped]

from cellwatt.errors import CellwattError
from cellwatt.fetch import again, origin


class _Pickler(cloudpickle.Pickler):  # type: ignore[misc]
    """Takes functions of a script or a session too, which a worker could not import."""

    def reducer_override(self, obj: Any) -> Any:
        if isinstance(obj, Path) and (found := origin(obj)) is not None:
            return again, (found,)
        return super().reducer_override(obj)


def pack(content: object) -> bytes:
    """Bytes of any picklable object."""
    file = io.BytesIO()
    _Pickler(file, protocol=5).dump(content)
    return file.getvalue()


def unpack(parcel: bytes) -> Any:
    """The object of ``pack``. Raises ``CellwattError`` where a file cannot be fetched."""
    return pickle.loads(parcel)


def pack_error(error: Exception) -> bytes:
    """Bytes of an error, that of a bug with its traceback as a note; one that cannot be pickled becomes its text."""
    try:
        if not isinstance(error, CellwattError):
            error.add_note("on a worker:\n" + "".join(traceback.format_exception(error)))
        parcel = pack(error)
        if isinstance(unpack(parcel), type(error)):
            return parcel
    except Exception:  # an exception class of others may fail in any way
        pass
    return pack(CellwattError(f"{type(error).__name__}: {' '.join(str(error).split())}"))
