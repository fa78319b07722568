"""Memory of a worker: what one array has freed is kept for the next."""

from __future__ import annotations

import ctypes
import sys
from functools import cache
from typing import Final

_TRIM_THRESHOLD: Final = -1
_MMAP_THRESHOLD: Final = -3
"""Parameters of ``mallopt`` (glibc, malloc.h)."""
_KEPT: Final = 64 << 20
_LARGEST: Final = 32 << 20
"""Bytes that a process keeps, and of the largest block that it keeps: what glibc itself comes to with arrays in use."""


@cache
def keep_freed_memory() -> None:
    """Let this process keep memory that it has freed, as any other program does.

    dask starts its workers with ``MALLOC_TRIM_THRESHOLD_``, so that each array above 128 kB is fetched from the system
    and given back: that takes longer than to compute with it. Elsewhere than with glibc nothing is done.
    """
    if sys.platform != "linux":
        return
    library = ctypes.CDLL(None)
    if hasattr(library, "mallopt"):
        library.mallopt(_MMAP_THRESHOLD, _LARGEST)
        library.mallopt(_TRIM_THRESHOLD, _KEPT)
