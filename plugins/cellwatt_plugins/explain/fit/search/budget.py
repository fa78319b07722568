"""The time limit of a search."""

from __future__ import annotations

import time

from cellwatt.scheduler import workers


def now() -> float:
    """Seconds on the clock of a search: CPU time of this process, so that waiting does not count.

    With worker processes it is elapsed time.
    """
    return time.process_time() if workers() is None else time.monotonic()
