"""Linear algebra in one thread: the same numbers wherever a part of the work is done, and a core for each worker."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext
from typing import Any

_known: tuple[int, Any] = (-1, None)
"""Number of modules that were loaded when the libraries were looked for, and what limits those."""


def one_thread() -> AbstractContextManager[object]:
    """Let BLAS and OpenMP have one thread inside; as they are where threadpoolctl is not installed."""
    global _known  # looking for the libraries takes 5 ms, which is long beside a small item
    if len(sys.modules) != _known[0]:
        try:
            from threadpoolctl import ThreadpoolController
        except ModuleNotFoundError:
            return nullcontext()
        found = ThreadpoolController()
        _known = (len(sys.modules), found)
    limited: AbstractContextManager[object] = _known[1].limit(limits=1)
    return limited
