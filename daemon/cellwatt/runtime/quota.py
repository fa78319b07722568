"""How much one source may say and send: what a device does, however fast, never costs the others their turn."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Final

BURST: Final = 20
"""Events of one kind that are told at once …"""
REFILL: Final = 2.0
"""… and s until one more is."""
MULTIPLE: Final = 4.0
"""Times its declared rate that a stream may send in the long run …"""
CATCH_UP: Final = 60.0
"""… and s of it that may come at once, after a stall."""
USUAL_RATE: Final = 100.0
"""Hz, taken for streams that declare none."""


class Bucket:
    """Tokens that fill up at ``rate`` a second to at most ``size``; full ``now``. Times are monotonic, s."""

    __slots__ = ("_at", "_rate", "_size", "tokens")

    def __init__(self, rate: float, size: float, now: float) -> None:
        self._rate, self._size, self._at = rate, size, now
        self.tokens = size

    def fill(self, now: float) -> float:
        """Add what time has brought; gives the tokens there are."""
        self.tokens = min(self.tokens + (now - self._at) * self._rate, self._size)
        self._at = now
        return self.tokens


class Telling:
    """Which events of a source are told: of each kind ``BURST`` at once, then one every ``REFILL`` s."""

    def __init__(self) -> None:
        self._buckets: dict[str, Bucket] = {}
        self._withheld: defaultdict[str, int] = defaultdict(int)

    def admit(self, kind: str, now: float) -> int | None:
        """How many of this kind were withheld since the last one that was told; ``None`` where this one is, too."""
        bucket = self._buckets.get(kind) or self._buckets.setdefault(kind, Bucket(1 / REFILL, BURST, now))
        if bucket.fill(now) < 1:
            self._withheld[kind] += 1
            return None
        bucket.tokens -= 1
        return self._withheld.pop(kind, 0)


class Sending:
    """Whether the streams of a source, with their declared ``rates`` in Hz, send no more than they may."""

    def __init__(self, rates: Mapping[str, float], now: float) -> None:
        self._rates = {name: rate or USUAL_RATE for name, rate in rates.items()}
        self._buckets = {n: Bucket(MULTIPLE * r, max(CATCH_UP * r, 100.0), now) for n, r in self._rates.items()}

    def excess(self, stream: str, n: int, now: float) -> str:
        """Note ``n`` samples more; gives in words what is too much, or nothing."""
        bucket = self._buckets[stream]
        bucket.tokens -= n
        if bucket.tokens >= 0 or bucket.fill(now) >= 0:
            return ""
        return (
            f"{stream} comes at more than {MULTIPLE:g} times its {self._rates[stream]:g} Hz for longer than a stall "
            f"of {CATCH_UP:g} s explains: check what answers at this address"
        )
