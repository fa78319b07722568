"""Limits of one source: samples beyond its declared rate and repeated events are counted, not passed on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

SECOND: Final = 1_000_000_000
MULTIPLE: Final = 4.0
"""Largest continuous rate of a stream, in multiples of its declared rate …"""
BACKLOG: Final = 30.0
"""… and largest burst, in s of its declared rate: after a stall, a device or network delivers its backlog at once."""
UNDECLARED: Final = 1000.0
"""Rate in Hz assumed for a stream that declares none."""
SHARE, BURST, USUAL = 1.1, 2.0, 100.0
"""The same three limits while the ring to the other processes is crowded; ``USUAL`` Hz is the assumed rate then."""

MINUTE: Final = 60 * SECOND
MOST: Final = 100
"""Largest number of events of a kind in a minute that are reported one by one."""
ONCE: Final = frozenset({"clock_reset", "clock_step", "beyond_rate", "counter_misread"})
"""Kinds of which one event a minute is reported: health counts them separately."""
LONGEST: Final = 600
"""Largest length in characters of an event's text, which may come from a device."""


class Allowance:
    """Limits of the samples of one stream; ``rate`` Hz as declared. ``now`` is the cell's clock, ns.

    ``crowded`` returns whether samples of this stream beyond its rate would displace those of others.
    """

    __slots__ = ("_crowded", "_share", "_usual")

    def __init__(self, rate: float, now: Callable[[], int], crowded: Callable[[], bool]) -> None:
        usual = rate or UNDECLARED
        self._usual = _Bucket(MULTIPLE * usual, BACKLOG * usual, now)
        self._share = _Bucket(SHARE * (rate or USUAL), BURST * (rate or USUAL), now)
        self._crowded = crowded

    def take(self, n: int) -> int:
        """Return how many of the next ``n`` samples are allowed."""
        allowed = self._usual.take(n)
        return self._share.take(allowed) if self._crowded() else allowed


class _Bucket:
    """A token bucket: ``most`` at once, ``rate`` Hz continuously.

    It is refilled only when it is empty, so that a sample costs a subtraction.
    """

    __slots__ = ("_fill", "_filled", "_most", "_now", "_tokens")

    def __init__(self, rate: float, most: float, now: Callable[[], int]) -> None:
        self._fill = rate / SECOND
        self._most = self._tokens = max(1.0, most)
        self._now = now
        self._filled = now()

    def take(self, n: int) -> int:
        """Return how many of the next ``n`` samples are allowed."""
        self._tokens -= n
        return n if self._tokens >= 0 else self._refill(n)

    def _refill(self, n: int) -> int:
        now = self._now()
        tokens = min(self._tokens + n + (now - self._filled) * self._fill, self._most)
        self._filled = now
        allowed = min(n, int(tokens))
        self._tokens = tokens - allowed
        return allowed


class Repeats:
    """Passes ``MOST`` events of a kind in a minute, or one for kinds in ``ONCE``, and counts the others."""

    def __init__(self) -> None:
        self._minutes: dict[str, list[int]] = {}
        """End of the running minute, ns, events passed in it, and events held back, by kind."""

    def tell(self, kind: str, now: int) -> bool:
        """True if an event passes now; call ``over`` first, which ends the minutes that are over."""
        minute = self._minutes.get(kind)
        if minute is None:
            minute = self._minutes[kind] = [now + MINUTE, 0, 0]
        if minute[1] < (1 if kind in ONCE else MOST):
            minute[1] += 1
            return True
        minute[2] += 1
        return False

    def over(self, now: int) -> list[tuple[str, int]]:
        """Kinds whose minute is over and had events held back, with their number."""
        ended = {kind: minute for kind, minute in self._minutes.items() if now >= minute[0]}
        for kind in ended:
            del self._minutes[kind]
        return [(kind, held) for kind, (_, _, held) in ended.items() if held]


def one_line(text: str) -> str:
    """Make a text, possibly from a device, a line of the log: no control characters, limited length."""
    if len(text) > LONGEST:
        text = f"{text[:LONGEST]} …"
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)
