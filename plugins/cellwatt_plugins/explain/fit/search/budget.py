"""The time that a search may take."""

from __future__ import annotations

import time

from cellwatt.scheduler import workers


def now() -> float:
    """Seconds on the clock of a search: computing of this process, whose waiting is nobody's fault.

    Where workers do the computing it is the time of day's.
    """
    return time.process_time() if workers() is None else time.monotonic()
