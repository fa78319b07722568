"""Tries at passwords and tokens: after a few that failed the next has to wait, longer each time."""

from __future__ import annotations

import logging
import math
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Sequence
from typing import Final

from cellwatt.door.port import peer_of
from cellwatt.host import stays_here

log = logging.getLogger(__name__)

FAILED: Final = "failed logins"
"""Count of wrong passwords and tokens in an outlet's health …"""
REFUSED: Final = "logins refused"
"""… and of tries that came before their wait was over."""

FREE: Final = 5
"""Tries that fail before the next has to wait."""
LONGEST: Final = 300.0
"""Longest wait, s."""
FORGOTTEN: Final = 3600.0
"""s after the last try at which the earlier ones no longer count."""
MOST: Final = 10_000
"""Addresses and names that are remembered; the oldest goes."""


class Guard:
    """The tries at one door, the same at every door; ``counts`` are for health, which raises the alarm.

    A try counts for its peer and its account, the name that it claims. A try from this PC counts for its account
    alone: behind a proxy on this PC everybody has its address. ``account`` is empty where one token is for all.
    ``clock`` is monotonic, s.
    """

    def __init__(self, door: str, counts: Counter[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._door, self._counts, self._clock = door, counts, clock
        self._failed: OrderedDict[str, tuple[int, float]] = OrderedDict()
        """Tries that failed, and the time of the last, by peer and by account."""

    def begin(self, address: str, account: str) -> float:
        """Begin a try; it counts as failed until ``succeed``: those that run side by side count, too.

        Return the time in s that it has to wait instead.
        """
        now, who = self._clock(), _who(address, account)
        if wait := max(self._wait(key, now) for key in who):
            self._counts[REFUSED] += 1
            return wait
        for key in who:
            failed, last = self._failed.pop(key, (0, now))
            self._failed[key] = (1 if now - last > FORGOTTEN else failed + 1, now)
        while len(self._failed) > MOST:
            self._failed.popitem(last=False)
        return 0.0

    def fail(self, address: str, account: str) -> None:
        """Count a try that failed, and log it."""
        self._counts[FAILED] += 1
        claimed = f" as {account!r:.100}" if account else ""
        log.warning("%s: a login%s from %s failed", self._door, claimed, address)

    def succeed(self, address: str, account: str) -> None:
        """Forget the tries that failed before."""
        for key in _who(address, account):
            self._failed.pop(key, None)

    def _wait(self, key: str, now: float) -> float:
        failed, last = self._failed.get(key, (0, -math.inf))
        if failed < FREE:
            return 0.0
        return max(0.0, last + min(LONGEST, 2.0 ** min(failed - FREE, 30)) - now)


def _who(address: str, account: str) -> Sequence[str]:
    peer = peer_of(address)
    if stays_here(peer):
        return (f"account {account}",)
    return (f"peer {peer}", f"account {account}") if account else (f"peer {peer}",)
