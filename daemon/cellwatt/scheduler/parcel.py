"""Items, results and errors as bytes between a command and its workers, and what a worker does with them."""

from __future__ import annotations

import os
import pickle
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from cellwatt.errors import CellwattError
from cellwatt.scheduler.threads import one_thread

_held: tuple[Path, Any] | None = None
"""What the items of the present work share: the file with its bytes, and the value."""


def _value(shared: Path) -> Any:
    global _held  # one value a worker, however many items
    if _held is None or _held[0] != shared:
        _held = shared, pickle.loads(shared.read_bytes())
    return _held[1]


def call(parcel: bytes, folder: str, shared: Path | None) -> tuple[bool, bytes]:
    """Call the function with the item in the parcel, and with the ``shared`` value where there is one.

    Relative paths are those of ``folder``, where the command runs. Returns True and the packed result, or False and
    the packed error, which nobody is to try again or to log.
    """
    with suppress(OSError):  # not there: a relative path is not either, which the function tells
        os.chdir(folder)
    try:
        function, item = pickle.loads(parcel)
        with one_thread():
            return True, pickle.dumps(function(item) if shared is None else function(item, _value(shared)))
    except Exception as error:  # whatever the function raises is for the one who called spread
        return False, _pack_error(error)


def parcels(function: Callable[..., Any], items: Any) -> list[bytes]:
    """The calls of a function with each of the items, for ``call``."""
    return [pickle.dumps((function, item)) for item in items]


def result(answer: tuple[bool, bytes]) -> Any:
    """The result that ``call`` returned. Raises the error where it is one."""
    done, parcel = answer
    content = pickle.loads(parcel)
    if done:
        return content
    raise content


def _pack_error(error: Exception) -> bytes:
    """Bytes of an error, that of a bug with its traceback as a note; one that cannot be pickled becomes its text."""
    try:
        if not isinstance(error, CellwattError):
            error.add_note("on a worker:\n" + "".join(traceback.format_exception(error)))
        parcel = pickle.dumps(error)
        if isinstance(pickle.loads(parcel), type(error)):
            return parcel
    except Exception:  # an exception class of others may fail in any way
        pass
    return pickle.dumps(CellwattError(f"{type(error).__name__}: {' '.join(str(error).split())}"))


def shortened(item: object) -> str:
    """An item as a message names it."""
    text = " ".join(repr(item).split())
    return text if len(text) <= 100 else f"{text[:99]}…"
