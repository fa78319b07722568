"""What a worker does: one call of the function, in one thread."""

from __future__ import annotations

import os
from contextlib import suppress
from typing import Any, Final
from weakref import WeakValueDictionary

from cellwatt.scheduler.memory import keep_freed_memory
from cellwatt.scheduler.parcel import pack, pack_error, unpack
from cellwatt.scheduler.quiet import distributed
from cellwatt.scheduler.threads import one_thread

DONE: Final = "done"
FAILED: Final = "failed"
MISSING: Final = "missing"


class Shared:
    """A value that all items share, unpacked once in each worker; it travels between workers as its bytes."""

    def __init__(self, name: str, parcel: bytes) -> None:
        self.name = name
        self._parcel = parcel
        self._value: tuple[Any] | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        return Shared, (self.name, self._parcel)

    def value(self) -> Any:
        """The value. Raises ``CellwattError`` where it names a file that cannot be fetched."""
        if self._value is None:
            self._value = (unpack(self._parcel),)
        return self._value[0]


_here: WeakValueDictionary[str, Shared] = WeakValueDictionary()
"""What this worker holds, by name: dask keeps it alive for as long as a command wants it."""
_last: list[Shared] = []
"""The one that came last, which dask may have put on a disk."""


def hold(shared: Shared) -> Shared:
    """Keep a shared value for the calls that this worker is going to do."""
    _here[shared.name] = shared
    _last[:] = [shared]
    return shared


def call(parcel: bytes, folder: str, shared: str | None = None) -> tuple[str, Any]:
    """Call the function with the item in the parcel, and with the value of that name where one is shared.

    Relative paths are those of ``folder``, where the command runs.

    Returns ``DONE`` and the packed result, ``FAILED`` and the packed error, which dask is neither to try again nor to
    log, or ``MISSING`` and the worker's address where it does not hold the shared value.
    """
    held = _here.get(shared) if shared is not None else None
    if shared is not None and held is None:
        return MISSING, distributed.get_worker().address
    with suppress(OSError):  # not there: a relative path is not either, which the function tells
        os.chdir(folder)
    keep_freed_memory()
    try:
        function, item = unpack(parcel)
        with one_thread():
            result = function(item) if held is None else function(item, held.value())
        return DONE, pack(result)
    except Exception as error:  # whatever the function raises is for the one who called spread
        return FAILED, pack_error(error)
