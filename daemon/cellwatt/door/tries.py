"""Login attempts with passwords and tokens: after some failures, further attempts are delayed, longer each time."""

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
"""Name of the count of wrong passwords and tokens in an outlet's health."""
REFUSED: Final = "logins refused"
"""Name of the count of attempts made before their delay was over."""

FREE: Final = 5
"""Number of failed attempts before the next is delayed."""
LONGEST: Final = 300.0
"""Longest delay, s."""
FORGOTTEN: Final = 3600.0
"""Time, s, after the last attempt from which earlier ones no longer count."""
MOST: Final = 10_000
"""Most peers and accounts remembered; the oldest is discarded."""


class Guard:
    """The login attempts at one door; ``counts`` are shown in health, which raises the alarm.

    An attempt counts for its peer and for its account, the name that it claims. An attempt from this PC counts for
    its account only: behind a proxy on this PC, all clients have the PC's address. ``account`` is empty if all use
    one token. ``clock`` is monotonic, s.
    """

    def __init__(self, door: str, counts: Counter[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._door, self._counts, self._clock = door, counts, clock
        self._failed: OrderedDict[str, tuple[int, float]] = OrderedDict()
        """Number of failed attempts and time of the last, by peer and by account."""

    def begin(self, address: str, account: str) -> float:
        """Begin an attempt; it counts as failed until ``succeed``, so that concurrent attempts count, too.

        Return 0, or the time, s, to wait before an attempt is accepted.
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
        """Count a failed attempt, and log it."""
        self._counts[FAILED] += 1
        claimed = f" as {account!r:.100}" if account else ""
        log.warning("%s: a login%s from %s failed", self._door, claimed, address)

    def succeed(self, address: str, account: str) -> None:
        """Reset the failed attempts of the peer and the account."""
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
