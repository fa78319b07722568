"""Tries at passwords: after a few that failed the next has to wait, longer each time. Pure: times are given."""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from typing import Final

FREE: Final = 5
"""Tries that fail before the next has to wait."""
LONGEST: Final = 300.0
"""Longest wait, s."""
FORGOTTEN: Final = 3600.0
"""s after the last try at which the earlier ones no longer count."""
MOST: Final = 10_000
"""Addresses and names that are remembered; the oldest goes."""


class Tries:
    """Failed tries by address and by name; times are monotonic, s."""

    def __init__(self) -> None:
        self._failed: OrderedDict[str, tuple[int, float]] = OrderedDict()

    def wait(self, who: Sequence[str], now: float) -> float:
        """Time in s that a try by any of ``who`` has to wait; 0 for none."""
        return max((self._wait(key, now) for key in who), default=0.0)

    def begin(self, who: Sequence[str], now: float) -> None:
        """Count a try as failed until ``succeed`` says otherwise: those that run side by side count, too."""
        for key in who:
            failed, last = self._failed.pop(key, (0, now))
            self._failed[key] = (1 if now - last > FORGOTTEN else failed + 1, now)
        while len(self._failed) > MOST:
            self._failed.popitem(last=False)

    def succeed(self, who: Sequence[str]) -> None:
        """Forget what failed before."""
        for key in who:
            self._failed.pop(key, None)

    def _wait(self, key: str, now: float) -> float:
        failed, last = self._failed.get(key, (0, -math.inf))
        if failed < FREE:
            return 0.0
        return max(0.0, last + min(LONGEST, 2.0 ** min(failed - FREE, 30)) - now)
