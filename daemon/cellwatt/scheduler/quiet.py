"""The package distributed, without its log on the terminal: errors that matter come as exceptions."""

from __future__ import annotations

from typing import Any

import dask.config

_NONE = {"handlers": ["none"], "propagate": False}

# Its loggers get their handlers, which write to stderr, when it is imported.
with dask.config.set(
    logging={
        "version": 1,
        "disable_existing_loggers": False,
        "handlers": {"none": {"class": "logging.NullHandler"}},
        "loggers": {"distributed": _NONE, "tornado": _NONE},
    }
):
    import distributed as _distributed

distributed: Any = _distributed
"""The package, much of which has no types."""

__all__ = ["distributed"]
