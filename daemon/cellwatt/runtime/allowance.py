"""Limits of one source: samples beyond its declared rate and events that repeat are counted, not passed on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

SECOND: Final = 1_000_000_000
MULTIPLE: Final = 4.0
"""Times its declared rate that a stream may bring samples for as long as it likes …"""
BACKLOG: Final = 30.0
"""… and s of its declared rate at once: what waited in a device or network that stood still comes in one block."""
UNDECLARED: Final = 1000.0
"""Hz that a stream without a declared rate counts as declaring."""
SHARE, BURST, USUAL = 1.1, 2.0, 100.0
"""The same while the ring to the other processes is crowded: what it has room for. No rate declared is ``USUAL``."""

MINUTE: Final = 60 * SECOND
MOST: Final = 100
"""Events of a kind in a minute that are told one by one."""
ONCE: Final = frozenset({"clock_reset", "clock_step", "beyond_rate", "counter_misread"})
"""Kinds of which one a minute is told: health has counts of its own for them."""
LONGEST: Final = 600
"""Characters of an event's text, which may be a device's own."""


class Allowance:
    """Limits of the samples of one stream; ``rate`` Hz as declared. ``now`` is the cell's clock, ns.

    ``crowded`` says whether what one stream brings beyond its rate would cost others their samples.
    """

    __slots__ = ("_crowded", "_share", "_usual")

    def __init__(self, rate: float, now: Callable[[], int], crowded: Callable[[], bool]) -> None:
        usual = rate or UNDECLARED
        self._usual = _Bucket(MULTIPLE * usual, BACKLOG * usual, now)
        self._share = _Bucket(SHARE * (rate or USUAL), BURST * (rate or USUAL), now)
        self._crowded = crowded

    def take(self, n: int) -> int:
        """Number of the next ``n`` samples that may come."""
        allowed = self._usual.take(n)
        return self._share.take(allowed) if self._crowded() else allowed


class _Bucket:
    """A token bucket: ``most`` at once, ``rate`` Hz for ever.

    It is filled up only once it is empty, so that a sample costs a subtraction.
    """

    __slots__ = ("_fill", "_filled", "_left", "_most", "_now")

    def __init__(self, rate: float, most: float, now: Callable[[], int]) -> None:
        self._fill = rate / SECOND
        self._most = self._left = max(1.0, most)
        self._now = now
        self._filled = now()

    def take(self, n: int) -> int:
        """Number of the next ``n`` samples that may come."""
        self._left -= n
        return n if self._left >= 0 else self._refill(n)

    def _refill(self, n: int) -> int:
        now = self._now()
        left = min(self._left + n + (now - self._filled) * self._fill, self._most)
        self._filled = now
        allowed = min(n, int(left))
        self._left = left - allowed
        return allowed


class Repeats:
    """Lets through ``MOST`` events of a kind in a minute, one of those in ``ONCE``; the others it counts."""

    def __init__(self) -> None:
        self._minutes: dict[str, list[int]] = {}
        """End of the running minute, ns, events told in it, and events held back, by kind."""

    def tell(self, kind: str, now: int) -> bool:
        """True if an event is to be told now; a kind whose minute is over is looked at in ``over`` first."""
        minute = self._minutes.get(kind)
        if minute is None:
            minute = self._minutes[kind] = [now + MINUTE, 0, 0]
        if minute[1] < (1 if kind in ONCE else MOST):
            minute[1] += 1
            return True
        minute[2] += 1
        return False

    def over(self, now: int) -> list[tuple[str, int]]:
        """Kinds whose minute is over, with how many events of it were held back, where any were."""
        ended = {kind: minute for kind, minute in self._minutes.items() if now >= minute[0]}
        for kind in ended:
            del self._minutes[kind]
        return [(kind, held) for kind, (_, _, held) in ended.items() if held]


def one_line(text: str) -> str:
    """A text that may be a device's own as a line of the log: no control characters, not too long."""
    if len(text) > LONGEST:
        text = f"{text[:LONGEST]} …"
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)
